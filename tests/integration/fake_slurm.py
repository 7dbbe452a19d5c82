"""Stand-ins for SLURM's commands: ``sbatch`` keeps the script and runs its tasks on this machine.

Only what submitit uses. What they cannot show: queues, limits, several nodes.
"""

from pathlib import Path

JOB_ID = "4711"

SBATCH = f"""
cp "$1" "$FAKE_SLURM/submitted.sh"
echo "Submitted batch job {JOB_ID}"
[ -e "$FAKE_SLURM/hold" ] && exit 0
last=$(sed -n 's/^#SBATCH --array=0-\\([0-9]*\\).*/\\1/p' "$1")
for task in $(seq 0 "${{last:-0}}"); do
  export SLURM_JOB_ID=$((4711 + task)) SLURM_ARRAY_JOB_ID={JOB_ID} SLURM_ARRAY_TASK_ID=$task
  export SLURM_NTASKS=1 SLURM_JOB_NUM_NODES=1 SLURM_NODEID=0 SLURM_PROCID=0 SLURM_LOCALID=0
  export SLURM_JOB_NODELIST=node1
  setsid bash "$1" </dev/null >/dev/null 2>&1 &
done
"""
SRUN = """
while [ "${1#--}" != "$1" ]; do
  case "$1" in --output|--error) shift;; esac
  shift
done
exec "$@"
"""
SACCT = """
echo "JobID|State|NodeList"
for task in 0 1 2 3; do echo "4711_$task|RUNNING|node1"; done
"""


def install(folder: Path) -> dict[str, str]:
    """Write the commands into ``folder``; environment variables for whoever is to find them."""
    folder.mkdir()
    for name, script in (("sbatch", SBATCH), ("srun", SRUN), ("sacct", SACCT), ("scancel", "")):
        path = folder / name
        path.write_text(f"#!/bin/bash\n{script}")
        path.chmod(0o755)
    return {"FAKE_SLURM": str(folder)}


def sbatch_flags(folder: Path) -> dict[str, str]:
    """The ``#SBATCH`` lines of what was submitted last, without the dashes."""
    flags = {}
    for line in (folder / "submitted.sh").read_text().splitlines():
        if line.startswith("#SBATCH --"):
            name, _, value = line.removeprefix("#SBATCH --").partition("=")
            flags[name] = value
    return flags
