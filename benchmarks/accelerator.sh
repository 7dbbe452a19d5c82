#!/usr/bin/env bash
# What is measured on an NVIDIA GPU, in one call that fits a short loan of one: the gpu tests, the
# speed of the engines, and a training at the paper's scale for the rest of the time.
#
#   benchmarks/accelerator.sh [OUT]      OUT: where records are written (default benchmarks/results)
#
# MINUTES (default 9) is the time of the whole call. Each stage takes at most half of what is left,
# and writes as it goes, so that a call that is cut off loses only what it was doing. Another call
# with the same OUT skips what has its record and goes on with the training; AGAIN=1 repeats all but
# the training. DEVICE, NUM_ENVS and TRAIN (overrides of tlr-train) make it smaller.
set -uo pipefail
out=${1:-benchmarks/results}
mkdir -p "$out" && out=$(cd "$out" && pwd) || exit 2
cd "$(dirname "$0")/.." || exit 2
python=${PYTHON:-.venv/bin/python}
device=${DEVICE:-cuda}
again=${AGAIN:-}
total=$(awk -v minutes="${MINUTES:-9}" 'BEGIN { print int(60 * minutes) }')
failed=0
export XLA_PYTHON_CLIENT_PREALLOCATE=false JAX_DEFAULT_MATMUL_PRECISION=highest PYTHONUNBUFFERED=1

left() { echo $((total - SECONDS)); } # SECONDS: since the script began

echo "== device"
nvidia-smi --query-gpu=name,driver_version,memory.total --format=csv | tee "$out/device.csv"

log=$out/gpu_tests.log # of tests that came to their end; .part of those that did not
if [[ -e $log && -z $again ]]; then
  echo "== gpu tests: done before, see $log"
else
  limit=$(($(left) / 2))
  echo "== gpu tests, at most $limit s"
  timeout --foreground --signal=INT --kill-after=10 "$limit" \
    "$python" -m pytest -m gpu -rs -p no:cacheprovider 2>&1 | tee "$log.part"
  status=${PIPESTATUS[0]}
  case $status in
    124 | 137) echo "out of time; another call begins the tests anew" ;;
    *) echo "exit status $status" >>"$log.part" && mv "$log.part" "$log" ;;
  esac
fi
if [[ -e $log ]] && ! grep -qx "exit status 0" "$log"; then failed=1; fi

limit=$(($(left) / 2))
echo "== environment steps a second, at most $limit s"
# shellcheck disable=SC2086  # several numbers
timeout --foreground --kill-after=10 "$((limit + 10))" \
  "$python" benchmarks/environment_speed.py --device "$device" --num-envs ${NUM_ENVS:-4096 8192} \
  --seconds "$limit" ${again:+--again} --output "$out/environment_speed.json" || failed=1

# Time to end an iteration and to write a checkpoint, and a little that nobody has planned.
spare=$((total / 12 + 1))
limit=$(($(left) - spare))
if ((limit < spare)); then
  echo "== no time is left for the training; another call does it"
  exit $failed
fi
echo "== training at the paper's scale, optimizer=gwo, for $limit s"
# shellcheck disable=SC2086  # several overrides
timeout --foreground --signal=INT --kill-after=$((spare * 3 / 4 + 1)) "$limit" \
  "$python" -m tlr_exp.commands.train scale=paper optimizer=gwo physics=mjx device="$device" \
  resume=auto study=paper-scale runs_dir="$out/runs" tracking_uri=none scale.checkpoint_every=5 ${TRAIN:-}
status=$?
# 124 and 130: stopped at its time with a checkpoint, as intended.
case $status in 0 | 124 | 130) ;; *) failed=1 ;; esac
exit $failed
