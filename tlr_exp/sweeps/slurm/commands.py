"""SLURM's commands, and what their answers mean."""

import os
import re
import subprocess
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from shutil import which

from tlr_exp.sweeps.parallel import LauncherError, RefusedError
from tlr_exp.sweeps.slurm.settings import Needs

ANSWER_S = 60.0  # how long a controller may take to answer

# With these another try may succeed: the controller is away or busy. Anything else is a refusal.
_PASSING = re.compile(
    r"unable to contact|timed out|connection refused|temporarily|zero bytes|try again"
    r"|communication|busy",
    re.IGNORECASE,
)
_WIDTHS = {"JobArrayID": 40, "State": 24, "RestartCnt": 12, "Comment": 250, "Reason": 200}
_DEFAULT_ARRAY_SIZE = 1001  # SLURM's own

PENDING, COMPLETED, CANCELLED = "PENDING", "COMPLETED", "CANCELLED"
# Of a job that will not run any more.
ENDED = frozenset(
    {
        *("BOOT_FAIL", CANCELLED, COMPLETED, "DEADLINE", "FAILED", "NODE_FAIL"),
        *("OUT_OF_MEMORY", "PREEMPTED", "REVOKED", "TIMEOUT"),
    }
)
# Why a job can wait in a queue that works: it will start by itself.
_USUAL = frozenset(
    {
        *("None", "Resources", "Priority", "BeginTime", "JobArrayTaskLimit", "Dependency"),
        *("Licenses", "Cleaning", "Prolog", "NodeDown", "Reservation"),
    }
)
# A limit on what runs at once, not on a single job.
_LIMIT = re.compile(r"^(QOS|Assoc)(?!.*Per(Job|Node)).*(Max|Grp)")


class UnreachableError(LauncherError):
    """The controller does not answer now."""


@dataclass(frozen=True)
class Element:
    """One element of a job array, as the queue has it.

    Attributes:
        state: SLURM's word for it, such as PENDING.
        reason: SLURM's word for why it waits, "" for none.
        restarts: how often it was queued again.
        num: the job that it is, by its comment; None where that does not say it.
    """

    state: str
    reason: str = ""
    restarts: int = 0
    num: int | None = None

    @property
    def is_pending(self) -> bool:
        return self.state == PENDING

    @property
    def has_ended(self) -> bool:
        return self.state in ENDED

    @property
    def needs_a_person(self) -> bool:
        """True if it waits for something that does not come with time alone."""
        return self.is_pending and self.reason not in _USUAL and not _LIMIT.match(self.reason)


def require_slurm() -> None:
    """
    Raises:
        LauncherError: there is no SLURM here.
    """
    if which("sbatch") is None:
        raise LauncherError(
            "hydra/launcher=slurm: there is no sbatch here. It is for a machine from which one "
            "submits to a SLURM cluster; hydra/launcher=local works on this one"
        )


def comment_of(sweep: str, base: int) -> str:
    """The comment of every element of an array: its sweep, and the job of index 0."""
    return f"{sweep} from {base}"


def submit(script: str, options: Sequence[str]) -> str:
    """The id of the array that ``sbatch`` makes of the batch script file.

    Raises:
        RefusedError: SLURM does not take it; says why.
        UnreachableError: the controller does not answer; the array may have been made.
    """
    answer = _ask(["sbatch", "--parsable", *options, script])
    return answer.strip().splitlines()[-1].partition(";")[0]


def queue(sweep: str) -> dict[str, Element]:
    """The elements of a sweep that the controller remembers, by id (``4711_3``).

    They are known by their comment, which `sweep` begins; earlier versions had no more in it. The
    controller forgets those that have ended after some minutes.

    Raises:
        UnreachableError: the controller does not answer.
    """
    columns = ",".join(f"{name}:{width}" for name, width in _WIDTHS.items())
    mine = f"--user={os.getuid()}"
    try:
        text = _ask(["squeue", "--noheader", "--array", "--states=all", mine, "-O", columns])
    except RefusedError as error:  # of what it was asked nothing can be wrong
        raise UnreachableError(str(error)) from error
    found = {}
    for line in text.splitlines():
        cells, start = {}, 0
        for name, width in _WIDTHS.items():
            cells[name] = line[start : start + width].strip()
            start += width
        if cells["Comment"].startswith(sweep[: _WIDTHS["Comment"]]):
            # Held jobs have their reason in brackets in some versions.
            reason = cells["Reason"].strip("()")
            restarts = int(cells["RestartCnt"] or 0)
            num = _num(cells["JobArrayID"], cells["Comment"].removeprefix(sweep))
            found[cells["JobArrayID"]] = Element(_state(cells["State"]), reason, restarts, num)
    return found


def accounted(ids: Iterable[str]) -> dict[str, Element]:
    """The ends of those that the controller has forgotten, from the accounts.

    Empty where the cluster keeps none. Of an element that was taken out of the queue before it
    started there is no account under its own id.
    """
    wanted = sorted(ids)
    command = ["sacct", "--noheader", "--parsable2", "--allocations", "--format=JobID,State"]
    try:
        text = _ask([*command, f"--jobs={','.join(wanted)}"])
    except LauncherError:
        return {}
    rows = (line.split("|") for line in text.splitlines() if "|" in line)
    found = {row[0]: Element(_state(row[1])) for row in rows if row[0] in wanted}
    return {element: said for element, said in found.items() if said.has_ended}


def _num(element: str, comment_end: str) -> int | None:
    """The job that an element is: its index, after the job of index 0, as `comment_of` ends."""
    index, base = element.rpartition("_")[2], comment_end.rpartition(" from ")[2]
    return int(index) + int(base) if index.isdecimal() and base.isdecimal() else None


def _state(text: str) -> str:
    """Without who cancelled it."""
    return text.partition(" ")[0].rstrip("+")


def rename(element: str, name: str) -> None:
    """Give an element a name of its own; where that fails, it keeps that of its array."""
    try:
        _ask(["scontrol", "update", f"JobId={element}", f"JobName={name}"])
    except LauncherError:
        return


def requeue(element: str) -> None:
    """Queue an element again, which ends it now.

    By its id in the array: the number of one of the elements is that of the whole array.

    Raises:
        LauncherError: SLURM does not.
    """
    _ask(["scontrol", "requeue", element])


def array_size() -> int:
    """Above all indices that an element of an array may have."""
    try:
        text = _ask(["scontrol", "show", "config"])
    except LauncherError:
        return _DEFAULT_ARRAY_SIZE
    found = re.search(r"^MaxArraySize\s*=\s*(\d+)", text, re.MULTILINE)
    return max(1, int(found.group(1))) if found else _DEFAULT_ARRAY_SIZE


def largest_node(partition: str | None) -> Needs | None:
    """The largest node of a partition (None: the default one); None if not known."""
    where = [f"--partition={partition}"] if partition else []
    try:
        text = _ask(["sinfo", "--noheader", "-o", "%P %c %m", *where])
    except LauncherError:
        return None
    rows = [line.split() for line in text.splitlines() if len(line.split()) == 3]
    default = [row for row in rows if row[0].endswith("*")]
    sizes = [(int(row[1].rstrip("+")), int(row[2].rstrip("+"))) for row in default or rows]
    sizes = [size for size in sizes if min(size) > 0]  # a partition without nodes has zeros
    if not sizes:
        return None
    return Needs(max(cpus for cpus, _ in sizes), max(mem for _, mem in sizes))


def _ask(command: Sequence[str]) -> str:
    """The output of a command.

    Raises:
        RefusedError, UnreachableError: with what it says of that.
    """
    name = command[0]
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",  # of jobs with comments of their own
            timeout=ANSWER_S,
        )
    except FileNotFoundError:
        raise UnreachableError(f"SLURM: there is no {name} here") from None
    except subprocess.TimeoutExpired:
        raise UnreachableError(f"SLURM: {name} gave no answer for {ANSWER_S:g} s") from None
    if done.returncode == 0:
        return done.stdout
    kind = UnreachableError if _PASSING.search(done.stderr) else RefusedError
    raise kind(f"SLURM: {_words(done.stderr) or f'{name} ended with {done.returncode}'}")


def _words(text: str) -> str:
    """The complaint of a command, without its name before each line."""
    lines = [re.sub(r"^\w+: (error: |fatal: )?", "", line.strip()) for line in text.splitlines()]
    return "; ".join(line for line in lines if line)
