"""``tlr-train -m``: plans the sweep, waits for its turn, works it off, says how it ended."""

import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from hydra.types import HydraContext
from omegaconf import DictConfig, OmegaConf

from tlr_exp.config.load import ConfigError
from tlr_exp.machine.terminal import EXIT_FAILED, EXIT_INTERRUPTED, command
from tlr_exp.mlflow_sync.mirror import Mirror
from tlr_exp.mlflow_sync.tracking_uri import how_to_open
from tlr_exp.records.directory import FAILED, FINISHED, INTERRUPTED, RUNNING
from tlr_exp.records.run_directory import command_line
from tlr_exp.records.storage import atomic_write
from tlr_exp.records.sweep_directory import CANCELLED, SweepDirectory, SweepDirectoryError
from tlr_exp.sweeps.display import SweepDisplay, make_sweep_display, print_table
from tlr_exp.sweeps.hydra_launcher import HydraLauncher
from tlr_exp.sweeps.launching import Launcher
from tlr_exp.sweeps.monitor import Monitor, from_here, job_log
from tlr_exp.sweeps.parallel import RAY_LAUNCHER, SLURM_LAUNCHER, LauncherError, RefusedError
from tlr_exp.sweeps.plan import make_plan
from tlr_exp.sweeps.progress import JobState, job_states
from tlr_exp.sweeps.ray_launcher import RayLauncher
from tlr_exp.sweeps.session import Session
from tlr_exp.sweeps.slurm.launcher import SlurmLauncher
from tlr_exp.sweeps.spec import Plan
from tlr_exp.sweeps.stopping import Stopper, clear_stop

ANSWER_VARIABLE = "TLR_EXP_SWEEP_FILE"  # the file that gets the path of the sweep directory
GO_ON = "continue         repeat the command: finished runs are kept, the others continue"
TURN_S = 1.0  # how often it is looked whether another process has left the sweep


@command("tlr-train", wrong=(ConfigError, LauncherError))
def run_sweep(config: DictConfig, context: HydraContext) -> int:
    """The whole sweep that Hydra's multirun configuration describes; its exit status.

    0: every job is trained; 1: some failed; 2: the configuration is wrong, or a cluster refuses the
    jobs, and nothing was started; 130: interrupted.
    """
    plan = make_plan(config)
    launcher = _make_launcher(config, context, plan)
    sweep = SweepDirectory.prepare(plan.study_folder, plan.name, plan.sweep_id)
    _answer_with(sweep.path)
    with turn(sweep, plan):
        clear_stop(sweep.path)
        return _work(plan, sweep, launcher)


def _make_launcher(config: DictConfig, context: HydraContext, plan: Plan) -> Launcher:
    settings: dict[str, Any] = OmegaConf.to_container(config.hydra.launcher, resolve=True)  # type: ignore[assignment]
    name = str(settings.get("_target_")).rpartition(".")[2]
    if name == SLURM_LAUNCHER:
        return SlurmLauncher(settings, plan)
    if name == RAY_LAUNCHER:
        return RayLauncher(settings, plan.path)
    return HydraLauncher(config, context, plan)


@contextmanager
def turn(sweep: SweepDirectory, plan: Plan) -> Iterator[None]:
    """Hold the sweep; while another process does, show how far that is."""
    with ExitStack() as stack:
        try:
            stack.enter_context(sweep.lock(timeout_s=0.2))
        except SweepDirectoryError as error:
            with closing(make_sweep_display(plan.name, None)) as display:
                display.say(f"{error}\nWaiting for it; Ctrl-C does not stop it.")
                _wait_for(sweep, plan, display, stack)
        yield


def _wait_for(sweep: SweepDirectory, plan: Plan, display: SweepDisplay, stack: ExitStack) -> None:
    """Look until the sweep is free, then hold it in ``stack``."""
    while True:
        display.show(job_states(sweep, plan.jobs), "")
        time.sleep(TURN_S)
        with suppress(SweepDirectoryError):
            stack.enter_context(sweep.lock(timeout_s=0.2))
            return


def _work(plan: Plan, sweep: SweepDirectory, launcher: Launcher) -> int:
    mirror, status = None, FINISHED
    # Closed whatever happens: a live display hides the cursor of the terminal.
    with (
        closing(make_sweep_display(plan.name, plan.parallelism.slots)) as display,
        Stopper(sweep.path) as stopper,
    ):
        session = Session(plan, sweep, launcher, stopper, display.say)
        if not session.is_finished():
            mirror = _begin(session)
            try:
                status = _work_off(session, display)
            except RefusedError:
                mirror.finish()
                raise
    _say_how_it_ended(session, status)
    if mirror is not None and not mirror.finish():
        print(mirror.what_is_missing)
    return {FINISHED: 0, INTERRUPTED: EXIT_INTERRUPTED}.get(status, EXIT_FAILED)


def _begin(session: Session) -> Mirror:
    """Write what is about to be done; what brings it to MLflow from now on."""
    plan, sweep = session.plan, session.sweep
    sweep.begin(command_line(), len(plan.jobs), plan.description, {"scale": plan.scale})
    sweep.set_status(RUNNING, arms=list(plan.arms))
    session.prepare()
    return Mirror.start(sweep, plan.uri, plan.study)


def _work_off(session: Session, display: SweepDisplay) -> str:
    """Work off under the eyes of a monitor; how the sweep ended."""
    sweep, stopper = session.sweep, session.stopper
    monitor = Monitor(session, display)
    monitor.start()
    try:
        session.work_off()
    except BaseException:
        # A third Ctrl-C, or a full disk: nobody comes back to write it later.
        sweep.set_status(INTERRUPTED if stopper.stopping else FAILED)
        raise
    finally:
        monitor.finish()
    trained = all(state.status == FINISHED for state in session.states())
    status = FINISHED if trained else (INTERRUPTED if stopper.stopping else FAILED)
    sweep.set_status(status)
    return status


def _say_how_it_ended(session: Session, status: str) -> None:
    plan, states = session.plan, session.states()
    print()
    print_table(states, [job_log(plan.path, state) for state in states])
    print(f"\nsweep directory  {from_here(plan.path)}")
    if plan.uri is not None:
        print(f"dashboard        {how_to_open(plan.uri, plan.study_folder.parent)}")
    print(f"{plan.name}: {_in_short(states, status)}")
    if status != FINISHED:
        print(GO_ON)
    if session.launcher_error is not None:
        print(session.launcher_error, file=sys.stderr)
    if queued := session.launcher.left_in_the_queue():
        print(f"{queued}\nor repeat the command to watch them; otherwise they end once they start")


def _in_short(states: Sequence[JobState], status: str) -> str:
    """The number of trained jobs, and the numbers of those that failed or were cancelled."""
    if status == FINISHED:
        return f"all {len(states)} jobs are trained"
    rest = sum(state.status != FINISHED for state in states)
    text = f"{status}; {rest} of {len(states)} jobs are not fully trained"
    for end in (FAILED, CANCELLED):
        if nums := [str(state.num) for state in states if state.status == end]:
            text += f"; {end}: {', '.join(nums)}"
    return text


def _answer_with(sweep: Path) -> None:
    """Tell a script which directory it has asked for, where it named a file to be told in."""
    if answer := os.environ.get(ANSWER_VARIABLE):
        atomic_write(Path(answer), f"{from_here(sweep)}\n".encode())
