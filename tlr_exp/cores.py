"""The cores that a process may use, and how the threads of libraries share them."""

import os

# OpenMP's threads spin while they wait, which on a busy machine slows the policy's update several
# times. So briefly, they cost 4 % on an idle one. Read when PyTorch is imported.
OPENMP_DEFAULTS = {"GOMP_SPINCOUNT": "5000"}


def available_cores() -> int:
    """Cores that this process may use: those of its affinity, of which a cluster gives a few."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
