"""A Ray of two nodes on loopback, each with one processor: two raylets and what they need."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.patience import HANG_S


@contextmanager
def two_raylets() -> Iterator[Any]:
    """Ray's own cluster for tests; all of its processes have ended outside."""
    from ray.cluster_utils import Cluster

    size = {"num_cpus": 1, "object_store_memory": 80 * 1024 * 1024}
    cluster = Cluster(initialize_head=True, head_node_args={**size, "include_dashboard": False})
    try:
        cluster.add_node(**size)
        yield cluster
    finally:
        cluster.shutdown()


def lose_node_of(cluster: Any, pid: int) -> None:
    """Kill the node above process ``pid``, which must not be the head.

    Its raylet must be reaped, too: the workers below look only for its process id, and would go on
    as long as there is a zombie of that. Ray's own way of removing a node gives up after 30 s,
    which a busy machine can take.
    """
    ancestors = set(_ancestors(pid))
    (raylet,) = [each for node in cluster.worker_nodes if (each := _raylet(node)).pid in ancestors]
    raylet.kill()
    raylet.wait(HANG_S)


def is_on_head(cluster: Any, pid: int) -> bool:
    """Whether process ``pid`` is below the head's raylet."""
    return _raylet(cluster.head_node).pid in _ancestors(pid)


def _raylet(node: Any) -> subprocess.Popen[bytes]:
    return node.all_processes["raylet"][0].process


def _ancestors(pid: int) -> list[int]:
    found = []
    while pid > 1:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        pid = int(fields[1])
        found.append(pid)
    return found
