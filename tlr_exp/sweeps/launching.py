"""What every launcher does for a sweep, whatever it is made of."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Protocol

from tlr_exp.sweeps.progress import Remark
from tlr_exp.sweeps.spec import PlannedJob
from tlr_exp.sweeps.stopping import Stopper


class Launcher(Protocol):
    """Hands jobs to whatever runs them.

    Attributes:
        leaves_by_itself: whether `launch` ends by itself once the sweep is to stop and none of its
            jobs runs, although some still wait in a queue.
        remarks: what the queue says of jobs that wait in it, by number.
    """

    leaves_by_itself: bool

    @property
    def remarks(self) -> Mapping[int, Remark]: ...

    def held(self) -> Collection[int]:
        """The jobs that an earlier attempt handed over and that have not ended.

        Raises:
            LauncherError: nobody can say now.
        """
        ...

    def launch(
        self, jobs: Sequence[PlannedJob], stopper: Stopper, say: Callable[[str], None]
    ) -> None:
        """Hand over those jobs that are not `held`, and wait until all have ended.

        Raises:
            Left: the sweep is to stop, and jobs are left in a queue.
            RefusedError: the jobs cannot be run as they are.
            LauncherError: the launcher broke down; jobs may or may not have run.
        """
        ...

    def left_in_the_queue(self) -> str:
        """For the person: which jobs still wait there and how to take them out; "" for none."""
        ...
