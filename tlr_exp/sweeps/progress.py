"""Reads how far a sweep is from what its jobs have written, and how long it will take."""

import heapq
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from tlr_exp.records.directory import FINISHED, INTERRUPTED, RUNNING
from tlr_exp.records.run_directory import METRICS
from tlr_exp.records.storage import while_unchanged
from tlr_exp.records.sweep_directory import WAITING, SweepDirectory, SweepDirectoryError
from tlr_exp.sweeps.spec import JobSpec

_TAIL_BYTES = 1 << 16  # longer than any line of metrics


QUEUED_AGAIN, HELD = "queued again", "held"


@dataclass(frozen=True)
class Remark:
    """The state that a cluster's queue gives a job that waits in it.

    Attributes:
        status: what the job is rather than waiting, such as QUEUED_AGAIN.
        reason: the cluster's own word for why it waits, "" where that need not be said.
        stuck: whether time alone will not start it.
    """

    status: str = WAITING
    reason: str = ""
    stuck: bool = False


@dataclass(frozen=True)
class JobState:
    """One job as it is shown: by its record, how far its run is, and what the queue says of it."""

    num: int
    label: str
    status: str
    run: Path | None
    error: str | None
    done: int
    total: int
    reason: str = ""
    stuck: bool = False


def job_states(
    sweep: SweepDirectory, jobs: Sequence[JobSpec], remarks: Mapping[int, Remark] | None = None
) -> list[JobState]:
    """Each job as it stands on disk and, by the `remarks` on some of them, in the queue."""
    return [_state(sweep, job, (remarks or {}).get(job.num)) for job in jobs]


def _state(sweep: SweepDirectory, job: JobSpec, remark: Remark | None) -> JobState:
    run, status, error, done = None, WAITING, None, 0
    with suppress(SweepDirectoryError):  # not written yet
        record = sweep.job(job.num)
        run = None if record.run is None else sweep.study_folder / record.run
        status, error = record.status, record.error
    if status == FINISHED:
        done = job.iterations
    elif run is not None:
        done = min(last_iteration(run / METRICS), job.iterations)
    # The job of a lost node may yet write that it was interrupted.
    if remark is None or status not in (WAITING, INTERRUPTED):
        remark = Remark(status)
    return JobState(
        num=job.num,
        label=job.label,
        status=remark.status,
        run=run,
        error=error,
        done=done,
        total=job.iterations,
        reason=remark.reason,
        stuck=remark.stuck,
    )


@while_unchanged
def last_iteration(metrics: Path) -> int:
    """The iteration of the last whole line of a metrics file; 0 where there is none."""
    with suppress(OSError), open(metrics, "rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - _TAIL_BYTES))
        for line in reversed(file.read().split(b"\n")[:-1]):
            with suppress(ValueError, KeyError, TypeError):
                return int(json.loads(line)["iteration"])
    return 0


def counts(states: Sequence[JobState]) -> Mapping[str, int]:
    """The number of jobs of each status."""
    return Counter(state.status for state in states)


class Pace:
    """Seconds that an iteration takes in this sweep, and what that means for the rest.

    Args:
        slots: jobs at once; None where a cluster decides, which is then learned from what is seen.
    """

    def __init__(self, slots: int | None) -> None:
        self._slots = slots
        self._seen_slots = 1
        self._start: dict[int, tuple[float, int]] = {}
        self._spent: dict[int, tuple[float, int]] = {}

    def note(self, states: Sequence[JobState], now_s: float) -> None:
        """Take in what the jobs have done until ``now_s`` (any clock)."""
        running = [state for state in states if state.status == RUNNING]
        self._seen_slots = max(self._seen_slots, len(running))
        for state in running:
            start_s, first = self._start.setdefault(state.num, (now_s, state.done))
            # A resumed job drops the iterations after its checkpoint.
            first = min(first, state.done)
            self._start[state.num] = (start_s, first)
            self._spent[state.num] = (now_s - start_s, state.done - first)

    @property
    def seconds_per_iteration(self) -> float | None:
        """Mean over the jobs, their start-up included; None before the first iteration."""
        seconds = sum(spent for spent, _ in self._spent.values())
        iterations = sum(done for _, done in self._spent.values())
        return seconds / iterations if iterations else None

    def eta_s(self, states: Sequence[JobState]) -> float | None:
        """Seconds until the last job ends, given to the slots as they become free; None: unknown.

        Jobs that have failed or were interrupted are not counted on; of one that is stuck in a
        queue nobody knows.
        """
        pace = self.seconds_per_iteration
        if pace is None or any(state.stuck for state in states):
            return None
        left = {RUNNING: list[int](), WAITING: list[int]()}
        for state in states:
            status = WAITING if state.status == QUEUED_AGAIN else state.status
            if status in left:
                left[status].append(state.total - state.done)
        return pace * makespan(left[RUNNING], left[WAITING], self._slots or self._seen_slots)


def makespan(running: Sequence[int], waiting: Sequence[int], slots: int) -> int:
    """When the last of all tasks ends, each next one starting where a slot becomes free first."""
    free = sorted(running)
    free += [0] * (slots - len(free))
    heapq.heapify(free)
    for task in waiting:
        heapq.heappush(free, heapq.heappop(free) + task)
    return max(free, default=0)
