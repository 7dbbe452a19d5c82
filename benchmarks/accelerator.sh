#!/usr/bin/env bash
# Everything that is measured on an NVIDIA GPU, in one call. Results go to benchmarks/results/.
#
#   benchmarks/accelerator.sh [OUT]      OUT: where records are written (default benchmarks/results)
#
# MINUTES (default 20) bounds the paper-scale run; it is resumable: call again to continue it.
set -uo pipefail
failed=0
cd "$(dirname "$0")/.."
out=${1:-benchmarks/results}
python=${PYTHON:-.venv/bin/python}
minutes=${MINUTES:-20}
mkdir -p "$out"
export XLA_PYTHON_CLIENT_PREALLOCATE=false JAX_DEFAULT_MATMUL_PRECISION=highest PYTHONUNBUFFERED=1

echo "== device"
nvidia-smi --query-gpu=name,driver_version,memory.total --format=csv | tee "$out/device.csv"

echo "== gpu tests"
$python -m pytest -m gpu -rs -p no:cacheprovider 2>&1 | tee "$out/gpu_tests.log" || failed=1

echo "== environment steps a second"
$python benchmarks/environment_speed.py --device cuda --output "$out/environment_speed.json" || failed=1

echo "== paper-scale run, optimizer=gwo, for $minutes minutes"
timeout --foreground --signal=INT --kill-after=60 "${minutes}m" \
  $python -m tlr_exp.train scale=paper optimizer=gwo physics=mjx device=cuda \
  resume=auto study=paper-scale runs_dir="$out/runs" tracking_uri=none
status=$?
# 124 and 130: stopped at its time with a checkpoint, as intended.
case $status in 0 | 124 | 130) ;; *) failed=1 ;; esac
exit $failed
