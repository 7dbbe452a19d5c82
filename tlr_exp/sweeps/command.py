"""``tlr-train -m``: plans the sweep, waits for its turn, works it off, says how it ended."""

from __future__ import annotations

import os
import shlex
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from tlr_exp.config.load import ConfigError
from tlr_exp.mlflow_sync.mirror import Mirror, how_to_open
from tlr_exp.records.run_directory import FAILED, FINISHED, INTERRUPTED, RUNNING, RunDirectoryError
from tlr_exp.records.storage import StorageError, atomic_write
from tlr_exp.records.sweep_directory import CANCELLED, SWEEPS, SweepDirectory, SweepDirectoryError
from tlr_exp.sweeps.display import SweepDisplay, make_sweep_display, print_table
from tlr_exp.sweeps.hydra_callback import HydraLauncher
from tlr_exp.sweeps.launching import Launcher
from tlr_exp.sweeps.monitor import Monitor, from_here, job_log
from tlr_exp.sweeps.parallel import RAY_LAUNCHER, SLURM_LAUNCHER, LauncherError, RefusedError
from tlr_exp.sweeps.plan import make_plan
from tlr_exp.sweeps.progress import JobState, Pace, job_states
from tlr_exp.sweeps.ray_launcher import RayLauncher
from tlr_exp.sweeps.session import Session
from tlr_exp.sweeps.slurm.launcher import SlurmLauncher
from tlr_exp.sweeps.spec import Plan
from tlr_exp.sweeps.stopping import Stopper, clear_stop
from tlr_exp.sweeps.task import JobTask
from tlr_exp.training.run import EXIT_CONFIG, EXIT_FAILED, EXIT_INTERRUPTED, print_error

ANSWER_VARIABLE = "TLR_EXP_SWEEP_FILE"  # the file that gets the path of the sweep directory
TURN_S = 1.0  # how often it is looked whether another process has left the sweep


def run_sweep(config: DictConfig) -> int:
    """The whole sweep that Hydra's multirun configuration describes; its exit status.

    0: every job is trained; 1: some failed; 2: the configuration is wrong, or a cluster refuses the
    jobs, and nothing was started; 130: interrupted.
    """
    try:
        plan = make_plan(config)
        folder = plan.study_folder / SWEEPS / f"{plan.name}-{plan.sweep_id}"
        launcher = _make_launcher(config, folder, plan)
    except ConfigError as error:
        print_error(error)
        return EXIT_CONFIG
    except LauncherError as error:
        print(error, file=sys.stderr)
        return EXIT_CONFIG
    try:
        sweep = SweepDirectory.prepare(plan.study_folder, plan.name, plan.sweep_id)
        _answer_with(sweep.path)
        with turn(sweep, plan):
            clear_stop(sweep.path)
            return _work(plan, sweep, launcher)
    except RefusedError as error:
        print(error, file=sys.stderr)
        return EXIT_CONFIG
    except KeyboardInterrupt:
        print("\ninterrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except (SweepDirectoryError, RunDirectoryError, StorageError) as error:
        print(error, file=sys.stderr)
        return EXIT_FAILED


def _make_launcher(config: DictConfig, folder: Path, plan: Plan) -> Launcher:
    settings: dict[str, Any] = OmegaConf.to_container(config.hydra.launcher, resolve=True)  # type: ignore[assignment]
    name = str(settings.get("_target_")).rpartition(".")[2]
    if name == SLURM_LAUNCHER:
        return SlurmLauncher(settings, plan, folder)
    if name == RAY_LAUNCHER:
        return RayLauncher(settings, folder)
    task = JobTask(str(folder), None if plan.parallelism.detached else os.getpid())
    return HydraLauncher(config, folder, task, plan.parallelism)


@contextmanager
def turn(sweep: SweepDirectory, plan: Plan) -> Iterator[None]:
    """Hold the sweep; while another process does, show how far that is."""
    with ExitStack() as stack:
        try:
            stack.enter_context(sweep.lock(timeout_s=0.2))
        except SweepDirectoryError as error:
            _wait_for(str(error), stack, sweep, plan)
        yield


def _wait_for(holder: str, stack: ExitStack, sweep: SweepDirectory, plan: Plan) -> None:
    """Look until the sweep is free, then hold it in ``stack``."""
    pace = Pace(None)
    with closing(make_sweep_display(plan.name, pace)) as display:
        display.say(f"{holder}\nWaiting for it; Ctrl-C leaves it alone.")
        while True:
            states = job_states(sweep, plan.jobs)
            pace.note(states, time.monotonic())
            display.show(states, "")
            time.sleep(TURN_S)
            with suppress(SweepDirectoryError):
                stack.enter_context(sweep.lock(timeout_s=0.2))
                return


def _work(plan: Plan, sweep: SweepDirectory, launcher: Launcher) -> int:
    pace = Pace(plan.parallelism.slots)
    # Closed whatever happens: a live display hides the cursor of the terminal.
    with closing(make_sweep_display(plan.name, pace)) as display:
        return _work_under(display, pace, plan, sweep, launcher)


def _work_under(
    display: SweepDisplay, pace: Pace, plan: Plan, sweep: SweepDirectory, launcher: Launcher
) -> int:
    with Stopper(sweep.path) as stopper:
        session = Session(plan, sweep, launcher, stopper, display.say)
        if session.is_finished():
            display.close()
            _say_how_it_ended(plan, sweep, job_states(sweep, plan.jobs), FINISHED)
            return 0
        sweep.begin(_command(), len(plan.jobs), plan.description, {"scale": plan.scale})
        sweep.set_status(RUNNING, arms=list(plan.arms))
        session.prepare()
        mirror = Mirror.start(sweep, plan.uri, plan.study)
        elsewhere = lambda: session.elsewhere  # noqa: E731
        monitor = Monitor(plan, sweep, stopper, display, pace, elsewhere, launcher)
        try:
            status = _work_off(session, monitor)
        except RefusedError:
            mirror.finish()
            raise
    states = monitor.states
    sweep.set_status(status)
    _say_how_it_ended(plan, sweep, states, status)
    if session.launcher_error is not None:
        print(session.launcher_error, file=sys.stderr)
    if queued := launcher.left_in_the_queue():
        print(f"{queued}\nor let them be: the same command watches them; else they end at once")
    if not mirror.finish():
        print(mirror.what_is_missing)
    return {FINISHED: 0, INTERRUPTED: EXIT_INTERRUPTED}.get(status, EXIT_FAILED)


def _work_off(session: Session, monitor: Monitor) -> str:
    """Work off under the eyes of the monitor; how the sweep ended."""
    monitor.start()
    try:
        session.work_off()
    except BaseException:
        # A third Ctrl-C, or a full disk: nobody comes back to write it later.
        session.sweep.set_status(INTERRUPTED if session.stopper.stopping else FAILED)
        raise
    finally:
        monitor.finish()
    return _status_of(monitor.states, session.stopper.stopping)


def _status_of(states: Sequence[JobState], stopped: bool) -> str:
    if all(state.status == FINISHED for state in states):
        return FINISHED
    return INTERRUPTED if stopped else FAILED


def _say_how_it_ended(
    plan: Plan, sweep: SweepDirectory, states: Sequence[JobState], status: str
) -> None:
    print()
    print_table(states, [job_log(sweep.path, state) for state in states])
    print(f"\nsweep directory  {from_here(sweep.path)}")
    if plan.uri is not None:
        print(f"dashboard        {how_to_open(plan.uri, plan.study_folder.parent)}")
    if status == FINISHED:
        print(f"{plan.name}: all {len(states)} jobs are trained")
        return
    failed = [str(state.num) for state in states if state.status == FAILED]
    rest = sum(state.status != FINISHED for state in states)
    print(f"{plan.name}: {status}; {rest} of {len(states)} jobs are not trained to the end", end="")
    print(f"; failed: {', '.join(failed)}" if failed else "", end="")
    cancelled = [str(state.num) for state in states if state.status == CANCELLED]
    print(f"; cancelled: {', '.join(cancelled)}" if cancelled else "")
    print("go on            repeat the command: what is trained is kept, the rest is gone on with")


def _answer_with(sweep: Path) -> None:
    """Tell a script which directory it has asked for, where it named a file to be told in."""
    if answer := os.environ.get(ANSWER_VARIABLE):
        atomic_write(Path(answer), f"{from_here(sweep)}\n".encode())


def _command() -> str:
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
