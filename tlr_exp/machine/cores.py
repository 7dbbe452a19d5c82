"""The cores that a process may use, and how the threads of libraries share them."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

# OpenMP's threads spin while they wait, which on a busy machine slows the policy's update several
# times. So briefly, they cost 4 % on an idle one. Read when PyTorch is imported.
OPENMP_DEFAULTS = {"GOMP_SPINCOUNT": "5000"}


def available_cores() -> int:
    """Cores that this process may use: those of its affinity, of which a cluster gives a few."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def one_torch_thread(device_type: str) -> Iterator[None]:
    """PyTorch works with one thread meanwhile, where it works on the CPU.

    For many small operations beside the engine, whose threads have the cores: PyTorch's would wait
    for one another at each, at ten times the time of the processor.
    """
    import torch

    threads = torch.get_num_threads()
    if device_type == "cpu":
        torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
