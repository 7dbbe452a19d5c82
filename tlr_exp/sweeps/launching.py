"""The base class of all launchers: what each does for a sweep, whatever it is made of."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence

from tlr_exp.sweeps.progress import Remark
from tlr_exp.sweeps.spec import JobSpec
from tlr_exp.sweeps.stopping import Stopper


class Launcher(ABC):
    """Hands jobs to whatever runs them; as it is, to something without a queue of its own.

    Attributes:
        leaves_by_itself: whether `launch` ends by itself once the sweep is to stop and none of its
            jobs runs, although some still wait in a queue.
        remarks: what the queue says of jobs that wait in it, by number.
    """

    def __init__(self) -> None:
        self.leaves_by_itself = True
        self.remarks: Mapping[int, Remark] = {}

    def held(self) -> Collection[int]:
        """The jobs that an earlier attempt handed over and that have not ended.

        Raises:
            LauncherError: nobody can say now.
        """
        return ()

    @abstractmethod
    def launch(self, jobs: Sequence[JobSpec], stopper: Stopper, say: Callable[[str], None]) -> None:
        """Hand over those jobs that are not `held`, and wait until all have ended.

        Raises:
            Left: the sweep is to stop, and jobs are left in a queue.
            RefusedError: the jobs cannot be run as they are.
            LauncherError: the launcher broke down; jobs may or may not have run.
        """

    def left_in_the_queue(self) -> str:
        """For the person: which jobs still wait there and how to take them out; "" for none."""
        return ""

    def _note(self, num: int, remark: Remark | None) -> None:
        """In a new mapping, because another thread reads the one that is there."""
        rest = {other: said for other, said in self.remarks.items() if other != num}
        self.remarks = rest if remark is None else {**rest, num: remark}
