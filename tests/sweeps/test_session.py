"""What a sweep starts, skips, waits for and gives up, with launchers that only write records."""

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace

import pytest

from tlr_exp.records.run_directory import LOCK
from tlr_exp.records.sweep_directory import SWEEP_LOCK
from tlr_exp.sweeps import session as sessions
from tlr_exp.sweeps.launching import Launcher
from tlr_exp.sweeps.parallel import LauncherError, RefusedError
from tlr_exp.sweeps.session import MAX_STARTS, Session
from tlr_exp.sweeps.spec import JobSpec, read_spec
from tlr_exp.sweeps.stopping import END, STOP, Left, Stopper, request_stop

HOLD = "import filelock, sys\nwith filelock.FileLock(sys.argv[1]):\n print(1, flush=True); input()"


class Ends:
    """Ends jobs as told (default: finished) and notes what it was given."""

    def __init__(self, sweep, ends=None) -> None:
        self.sweep, self.ends = sweep, ends or {}
        self.given: list[list[int]] = []

    def __call__(self, jobs: Sequence[JobSpec]) -> None:
        self.given.append([job.num for job in jobs])
        for job in jobs:
            status = self.ends.get(job.num, "finished")
            self.sweep.write_job(job.num, status, error="no" if status == "failed" else None)


@pytest.fixture
def begin(plan, sweep):
    """``begin(launch, plan=plan, held=())``: a session that is about to work off."""
    said: list[str] = []

    def make(launch, plan=plan, held=()) -> Session:
        class Given(Launcher):
            def held(self) -> Sequence[int]:
                return held

            def launch(self, jobs, stopper, say) -> None:
                launch(jobs)

        session = Session(plan, sweep, Given(), Stopper(sweep.path), said.append)
        session.said = said  # type: ignore[attr-defined]
        session.prepare()
        return session

    return make


def statuses(sweep):
    return [job.status for job in sweep.jobs()]


def test_all_jobs_are_handed_out_at_once_with_what_they_need(begin, sweep, plan):
    launcher = Ends(sweep)
    session = begin(launcher)
    assert statuses(sweep) == ["waiting"] * 3
    assert [job.overrides for job in sweep.jobs()] == [("seed=0",), ("seed=1",), ("seed=2",)]
    assert read_spec(sweep.path, 2) == plan.jobs[2]
    session.work_off()
    assert launcher.given == [[0, 1, 2]]
    assert statuses(sweep) == ["finished"] * 3


def test_finished_runs_are_skipped_and_broken_ones_handed_out_again(begin, sweep, make_run):
    runs = make_run(0, "finished"), make_run(1, "failed"), make_run(2, "running")  # 2 was killed
    launcher = Ends(sweep, {1: "failed"})
    session = begin(launcher)
    session.work_off()
    assert launcher.given == [[1, 2]]
    assert statuses(sweep) == ["finished", "failed", "finished"]
    first = sweep.job(0)
    assert (first.run, first.run_id) == (runs[0].path.name, runs[0].manifest["run_id"])
    assert session.said == ["job 0 (seed=0) is trained already: run0"]


def test_a_finished_run_counts_although_a_later_one_is_not(begin, sweep, make_run, plan):
    make_run(0, "finished")
    from tlr_exp.records.run_directory import RunDirectory

    later = RunDirectory.create(plan.study_folder / "later", {}, {}, plan.jobs[0].identity)
    later.set_status("failed")
    launcher = Ends(sweep)
    begin(launcher).work_off()
    assert launcher.given == [[1, 2]]
    assert sweep.job(0).run == "run0"


def test_new_runs_are_asked_for_by_resume_never(begin, sweep, make_run, plan):
    make_run(0, "finished")
    launcher = Ends(sweep)
    anew = [replace(job, config={**job.config, "resume": "never"}) for job in plan.jobs]
    begin(launcher, replace(plan, jobs=tuple(anew))).work_off()
    assert launcher.given == [[0, 1, 2]]


@pytest.mark.parametrize("ends_as", ["finished", "failed"])
def test_a_run_of_another_process_is_waited_for_and_then_looked_at_again(
    begin, sweep, make_run, monkeypatch, ends_as
):
    run = make_run(1, "running")
    pipe = subprocess.PIPE
    command = [sys.executable, "-c", HOLD, str(run.path / LOCK)]
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "1\n"
        launcher = Ends(sweep)
        session = begin(launcher)
        waited = []

        def wait(seconds: float) -> None:
            assert session.elsewhere == {1}
            waited.append(launcher.given.copy())
            run.set_status(ends_as)
            other.communicate("\n")

        monkeypatch.setattr(sessions.time, "sleep", wait)
        session.work_off()
    # The others went first; then the one that the other process left unfinished.
    assert waited == [[[0, 2]]]
    assert launcher.given == [[0, 2]] + ([[1]] if ends_as == "failed" else [])
    assert statuses(sweep) == ["finished"] * 3
    assert session.said[0] == "job 1 (seed=1) is trained by another process: wait"


def test_a_job_that_never_answers_is_given_up(begin, sweep):
    launcher = Ends(sweep, {1: "waiting"})
    begin(launcher).work_off()
    assert launcher.given == [[0, 1, 2]] + [[1]] * (MAX_STARTS - 1)
    assert statuses(sweep) == ["finished", "failed", "finished"]
    assert sweep.job(1).error == f"started {MAX_STARTS} times without an answer"


def test_a_stopped_sweep_hands_out_nothing_more(begin, sweep):
    def launch(jobs):
        sweep.write_job(0, "interrupted")
        request_stop(sweep.path, END)

    begin(launch).work_off()
    assert statuses(sweep) == ["interrupted", "waiting", "waiting"]


def test_the_file_of_a_person_stops_a_sweep_and_fails_no_job(begin, sweep):
    launcher = Ends(sweep, {0: "interrupted", 1: "waiting", 2: "waiting"})

    def launch(jobs):
        (sweep.path / STOP).touch()  # while job 0 runs; the others find it and do not start
        launcher(jobs)

    session = begin(launch)
    session.work_off()
    assert launcher.given == [[0, 1, 2]]
    assert statuses(sweep) == ["interrupted", "waiting", "waiting"]
    assert session.stopper.stopping


def test_the_file_ends_the_waiting_for_another_process(begin, sweep, make_run, monkeypatch):
    runs = [make_run(num, "running") for num in range(3)]
    monkeypatch.setattr(sessions.RunDirectory, "is_live", lambda run: True)
    waited = []

    def wait(seconds: float) -> None:
        waited.append(seconds)
        assert len(waited) < 3, "nobody looks at the file"
        (sweep.path / STOP).touch()

    monkeypatch.setattr(sessions.time, "sleep", wait)
    begin(Ends(sweep)).work_off()
    assert len(waited) == 1
    assert [run.status for run in runs] == ["running"] * 3


@pytest.mark.parametrize("error", [LauncherError("no nodes"), Left()])
def test_a_launcher_that_breaks_down_ends_the_attempt(begin, sweep, error):
    def launch(jobs):
        raise error

    session = begin(launch)
    session.work_off()
    assert session.launcher_error == (str(error) or None)
    assert statuses(sweep) == ["waiting"] * 3


def test_jobs_that_are_refused_as_they_are_end_the_command(begin, sweep):
    def launch(jobs):
        raise RefusedError("no such partition")

    with pytest.raises(RefusedError, match="no such partition"):
        begin(launch).work_off()
    assert statuses(sweep) == ["waiting"] * 3


def test_jobs_that_the_queue_holds_are_watched_with_the_records_that_they_wrote(
    begin, sweep, make_run
):
    make_run(0, "finished")
    run = make_run(1, "running")
    launcher = Ends(sweep)
    seen = []

    def launch(jobs):
        seen.extend(sweep.jobs())
        launcher(jobs)

    session = begin(launch, held=(0, 1))
    sweep.write_job(1, "running", run=run.path.name)
    session.work_off()
    assert launcher.given == [[1, 2]]
    assert [record.status for record in seen] == ["finished", "running", "waiting"]


def test_jobs_that_died_with_their_launcher_are_not_left_running(begin, sweep, make_run):
    run = make_run(0, "running")

    def launch(jobs):
        sweep.write_job(0, "running", run=run.path.name)
        raise LauncherError("killed")

    begin(launch).work_off()
    assert sweep.job(0).status == "failed"
    assert sweep.job(0).error == "it and its launcher were killed"


def test_a_finished_sweep_is_known_as_long_as_its_runs_are_there(begin, sweep, make_run, plan):
    session = begin(Ends(sweep))
    runs = [make_run(num, "finished") for num in range(3)]
    assert not session.is_finished()  # it says running
    sweep.set_status("finished")
    assert session.is_finished()
    runs[1].set_status("failed")
    assert not session.is_finished()
    assert not (sweep.path / SWEEP_LOCK).exists()  # looking takes no lock
