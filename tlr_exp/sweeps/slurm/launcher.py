"""Submits the jobs of a sweep that the queue does not have yet, and waits for each by itself."""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from typing import Any

from tlr_exp.records.directory import FINISHED
from tlr_exp.records.run_directory import RunDirectory, RunDirectoryError
from tlr_exp.records.sweep_directory import WAITING, SweepDirectory
from tlr_exp.sweeps.launching import Launcher
from tlr_exp.sweeps.parallel import RefusedError
from tlr_exp.sweeps.slurm.commands import (
    Element,
    UnreachableError,
    accounted,
    array_size,
    comment_of,
    largest_node,
    queue,
    rename,
    require_slurm,
    submit,
)
from tlr_exp.sweeps.slurm.elements import (
    arrays,
    in_short,
    read_elements,
    short_name,
    write_elements,
)
from tlr_exp.sweeps.slurm.settings import Needs, SlurmSettings, needs
from tlr_exp.sweeps.slurm.submission import options, was_submitted, write_script
from tlr_exp.sweeps.slurm.verdict import KEEP, Facts, in_the_queue, verdict
from tlr_exp.sweeps.spec import JobSpec, Plan
from tlr_exp.sweeps.stopping import Left, Stopper

TICK_S = 0.5
# How often SLURM is asked: every two seconds at first, more seldom while nothing changes.
ASK_S, ASK_AT_MOST_S, ASK_SLOWER = 2.0, 20.0, 1.2
# Absent so often in a row is gone; a controller that restarts can lack a job for an instant.
ABSENT_LOOKS = 3


class SlurmLauncher(Launcher):
    """One attempt at a sweep on SLURM (see tlr_exp.sweeps.launching).

    Attributes:
        remarks: of jobs that wait in the queue, what they are called there and SLURM's reason.

    Args:
        launcher: the configuration node hydra.launcher.

    Raises:
        LauncherError: there is no SLURM here, or the settings of the launcher cannot be.
    """

    def __init__(self, launcher: Mapping[str, Any], plan: Plan) -> None:
        super().__init__()
        require_slurm()
        self.settings = SlurmSettings.read(launcher)
        self.plan, self.sweep = plan, SweepDirectory(plan.path)
        # Asked for a node that is too small SLURM lets a job wait for ever.
        node = largest_node(self.settings.partition)
        self.needs: Needs = needs(self.settings, [job.config for job in plan.jobs], node)
        # In ASCII: squeue cuts its columns by bytes.
        comment = f"tlr_exp {plan.study} {plan.path.name}"
        self.comment = comment.encode("ascii", "replace").decode()
        self._queue: dict[str, Element] = {}
        self._absent: dict[int, int] = {}

    def held(self) -> set[int]:
        """The jobs that an earlier attempt submitted and that still wait or run in the queue.

        Raises:
            UnreachableError: the controller does not answer; then nothing may be submitted.
        """
        if not was_submitted(self.sweep.path):
            return set()
        self._queue = queue(self.comment)
        elements = read_elements(self.sweep.path)
        held = {num for num, element in elements.items() if self._waits_or_runs(element)}
        # Of an array whose sbatch gave no answer in time nobody has written down the id.
        unknown = {
            each.num: element
            for element, each in self._queue.items()
            if each.num is not None and each.num not in held and self._waits_or_runs(element)
        }
        if unknown:
            write_elements(self.sweep.path, elements | unknown)
        return held | set(unknown)

    def _waits_or_runs(self, element: str) -> bool:
        return element in self._queue and not self._queue[element].has_ended

    def left_in_the_queue(self) -> str:
        """Of this sweep, at the last look."""
        elements = read_elements(self.sweep.path).values()
        waiting = [element for element in elements if self._waits_or_runs(element)]
        return how_to_cancel(waiting) if waiting else ""

    # --- submitting --------------------------------------------------------------------------
    def submit(self, jobs: Sequence[JobSpec]) -> None:
        """Put jobs into the queue, and write down which element is which.

        Raises:
            RefusedError, UnreachableError: from then on nothing was submitted.
        """
        elements = read_elements(self.sweep.path)
        labels = {job.num: job.label for job in jobs}
        for base, nums in arrays(labels, array_size()).items():
            script = write_script(self.sweep.path, base, self.settings)
            indices = [num - base for num in nums]
            comment = comment_of(self.comment, base)
            asked = options(self.sweep.path, comment, self.settings, self.needs, indices)
            array = self._submit_one(str(script), asked)
            elements |= {num: f"{array}_{num - base}" for num in nums}
            write_elements(self.sweep.path, elements)
            for num in nums:
                if len(self.plan.jobs) > 1:  # alone it needs no other name
                    rename(elements[num], short_name(labels[num], self.settings.name))

    def _submit_one(self, script: str, asked: Sequence[str]) -> str:
        try:
            return submit(script, asked)
        except UnreachableError as error:
            raise UnreachableError(
                f"{error}\nWhether the jobs were submitted is not known: the same command looks "
                "for them in the queue before it submits any"
            ) from error
        except RefusedError as error:
            with suppress(UnreachableError):
                self.held()  # of what was taken before
            raise RefusedError(f"{error}\n{self.left_in_the_queue()}".strip()) from error

    # --- waiting -----------------------------------------------------------------------------
    def launch(self, jobs: Sequence[JobSpec], stopper: Stopper, say: Callable[[str], None]) -> None:
        """Submit those of the jobs that the queue lacks, and wait until each of them has ended.

        Raises:
            Left: the sweep is to stop, and none of its jobs runs any more.
            RefusedError, UnreachableError: see `submit`.
        """
        held = self.held()
        self.submit([job for job in jobs if job.num not in held])
        watched = sorted(held & {job.num for job in jobs})
        if watched:
            elements = read_elements(self.sweep.path)
            names = in_short(elements[num] for num in watched)
            say(f"{len(watched)} of the jobs are in the queue already, as {names}: watching them")
        waiting = {job.num for job in jobs}
        pause_s, complained = ASK_S, ""
        while waiting:
            before = (dict(self._queue), dict(self.remarks), len(waiting))
            try:
                self._queue = queue(self.comment)
                waiting -= self._look(waiting)
                complained = ""
            except UnreachableError as error:
                if str(error) != complained:
                    say(f"{error}\nThe jobs continue; asking again until it answers.")
                complained = str(error)
            if stopper.stopping and not self._any_runs(waiting):
                raise Left
            same = before == (self._queue, self.remarks, len(waiting))
            pause_s = min(ASK_AT_MOST_S, ASK_SLOWER * pause_s) if same else ASK_S
            self._rest(pause_s, stopper, waiting)

    def _look(self, waiting: Collection[int]) -> set[int]:
        """Write what became of the jobs; those that have ended."""
        elements = read_elements(self.sweep.path)
        forgotten = [elements[num] for num in waiting if elements[num] not in self._queue]
        known = self._queue | (accounted(forgotten) if forgotten else {})
        ended = set()
        for num in waiting:
            element = known.get(elements[num])
            self._absent[num] = 0 if element else self._absent.get(num, 0) + 1
            if element is None and self._absent[num] < ABSENT_LOOKS:
                continue
            facts = self._facts(num, element)
            self._note(num, in_the_queue(element))
            found = verdict(facts)
            if found is None:
                continue
            self._write(num, facts.record, found.status, found.error)
            if found.ended:
                ended.add(num)
                self._note(num, None)
        return ended

    def _facts(self, num: int, element: Element | None) -> Facts:
        record = self.sweep.job(num)
        if record.run is None:
            return Facts(record.status, None, False, element)
        run = RunDirectory(self.sweep.study_folder / record.run)
        try:
            # A record that waits can name the run of an earlier attempt.
            own = None if record.status == WAITING else run.status
            return Facts(record.status, own, run.is_live(), element)
        except RunDirectoryError:  # somebody moved it away
            return Facts(record.status, None, False, element)

    def _write(self, num: int, before: str, status: str, error: str | None) -> None:
        if error == KEEP or before == status == FINISHED:
            return
        self.sweep.write_job(num, status, error=error)

    def _any_runs(self, waiting: Collection[int]) -> bool:
        elements = read_elements(self.sweep.path)
        there = [elements[num] for num in waiting if self._waits_or_runs(elements[num])]
        return not all(self._queue[element].is_pending for element in there)

    def _rest(self, pause_s: float, stopper: Stopper, waiting: Collection[int]) -> None:
        """Until it is time to ask again, or something happened that changes the answer."""
        was_stopping, until = stopper.stopping, time.monotonic() + pause_s
        seen = [self.sweep.job(num).status for num in waiting]
        while waiting and time.monotonic() < until and stopper.stopping == was_stopping:
            time.sleep(TICK_S)
            if seen != [self.sweep.job(num).status for num in waiting]:
                return


def how_to_cancel(elements: Sequence[str]) -> str:
    """The elements still in the queue, and the command that removes them."""
    names = in_short(elements)
    return f"still in the queue  {names}\ncancel them        scancel {names}"
