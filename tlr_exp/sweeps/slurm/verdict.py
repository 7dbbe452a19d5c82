"""Decides what becomes of a job, from what its run, its record and the queue say of it."""

from collections.abc import Mapping
from dataclasses import dataclass

from tlr_exp.records.directory import FAILED, FINISHED, INTERRUPTED
from tlr_exp.records.sweep_directory import CANCELLED, WAITING
from tlr_exp.sweeps.progress import HELD, QUEUED_AGAIN, Remark
from tlr_exp.sweeps.slurm import commands
from tlr_exp.sweeps.slurm.commands import Element

KEEP = ""  # for an error: what the record says

# Why the queue says that a job has ended, where neither its run nor its record does.
_WORDS: Mapping[str, tuple[str, str]] = {
    "TIMEOUT": (
        INTERRUPTED,
        "ended by its time limit before its iteration was over: warn it sooner by "
        "hydra.launcher.signal_delay_s, or give more by hydra.launcher.timeout_min",
    ),
    "NODE_FAIL": (FAILED, "its node failed, and SLURM did not queue it again"),
    "PREEMPTED": (INTERRUPTED, "preempted, and SLURM did not queue it again"),
    "OUT_OF_MEMORY": (
        FAILED,
        "ended by SLURM for want of memory: give more by hydra.launcher.mem_gb",
    ),
}


@dataclass(frozen=True)
class Facts:
    """The facts known about a submitted job.

    Attributes:
        record: the status in the record of the job.
        run: the status of its run, None where it has none that is its own.
        live: whether a process trains the run now.
        element: what SLURM says; None: neither the queue nor the accounts know it.
    """

    record: str
    run: str | None
    live: bool
    element: Element | None


@dataclass(frozen=True)
class Verdict:
    """``status`` and ``error`` for the record of the job, and whether it has ended."""

    status: str
    error: str | None
    ended: bool


def verdict(facts: Facts) -> Verdict | None:
    """The new content of the record; None: it stays, and the job goes on.

    That a job is trained is said by its run alone. The queue says whether it may go on.
    """
    element = facts.element
    if facts.run == FINISHED and not facts.live:
        return Verdict(FINISHED, None, True)
    if element is not None and not element.has_ended:
        # Its node failed, or it was queued again: the record is that of the start before.
        if element.is_pending and not facts.live and facts.record != WAITING:
            return Verdict(WAITING, None, False)
        return None
    if facts.live:  # SLURM has let go of it, and it is about to end
        return None
    return Verdict(*_end(facts), True)


def _end(facts: Facts) -> tuple[str, str | None]:
    # What the controller has forgotten by now had told of its end by itself.
    if facts.element is None and facts.record in (FAILED, INTERRUPTED):
        return facts.record, KEEP
    state = commands.CANCELLED if facts.element is None else facts.element.state
    if state == commands.CANCELLED:
        return CANCELLED, "cancelled in SLURM's queue (scancel, or by an administrator)"
    if state == commands.COMPLETED and facts.record == WAITING:
        return WAITING, None  # it left the job to another process, or the sweep was stopped
    if facts.record == FAILED:
        return FAILED, KEEP
    if state in _WORDS:
        return _WORDS[state]
    if facts.record == INTERRUPTED:
        return INTERRUPTED, KEEP
    return FAILED, f"ended without saying why; SLURM says {state}"


def in_the_queue(element: Element | None) -> Remark | None:
    """The message about a job that waits in the queue; None if it does not wait there.

    The reason is told where the job had started before, or where it will not start by itself.
    """
    if element is None or not element.is_pending:
        return None
    stuck = element.needs_a_person
    if element.reason.lower().startswith(("jobheld", "job requeued in held", "launch failed")):
        return Remark(HELD, element.reason, stuck)
    if element.restarts:
        return Remark(QUEUED_AGAIN, element.reason, stuck)
    return Remark(WAITING, element.reason if stuck else "", stuck)
