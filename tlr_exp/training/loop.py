"""A training from start (or checkpoint) to end: iterations, and all that surrounds them."""

import io
import os
import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from types import FrameType
from typing import Any

import numpy as np
import torch

from tlr_exp import keys
from tlr_exp.assembly.environment import build_env, build_evaluation_env
from tlr_exp.assembly.learner import build_ppo
from tlr_exp.assembly.parts import Parts
from tlr_exp.assembly.split import build_judged_split
from tlr_exp.assembly.terms import terms_of_evaluation, terms_of_training
from tlr_exp.config.settings import Settings
from tlr_exp.errors import UserError
from tlr_exp.evaluation.result import EvaluationResult, evaluate_policy, mean_metrics
from tlr_exp.machine.cores import available_cores
from tlr_exp.machine.precision import chosen_precision
from tlr_exp.ppo.networks import in_float32
from tlr_exp.records.checkpoint import CheckpointStore
from tlr_exp.records.directory import FINISHED, INTERRUPTED, RUNNING
from tlr_exp.records.extending import former_totals
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.storage import StorageError, atomic_write
from tlr_exp.training.build import build_trainer
from tlr_exp.training.initial_policy import begin_with
from tlr_exp.training.kept_motion import kept_motion
from tlr_exp.training.progress import Display, make_display
from tlr_exp.training.stages import Stages, stage_facts

# The paper's snapshots (Figures 9-12) at iterations 100, 500, 1000 and 2200 of 2500.
SNAPSHOT_SHARES = (0.04, 0.2, 0.4, 0.88)
# More simulations than this share going wrong in one iteration is no accident.
MAX_UNSTABLE_SHARE = 0.01


class UnstableSimulationError(UserError):
    """Too many simulations stopped being finite in one iteration."""


@dataclass(frozen=True)
class Outcome:
    """The end of a training: its status and the last iteration that is safe in a checkpoint."""

    status: str
    iteration: int


class Training:
    """One run: its parts, restored from the newest checkpoint where there is one.

    Args:
        settings: the checked configuration.
        run: the run directory, locked by the caller.
        parts: what the check of the configuration has built.

    Raises:
        CheckpointError: there are checkpoints, and none can be read; or what a new run begins with
            cannot be.
        ConfigError: a part refuses its settings, or the device is not there.
    """

    def __init__(self, settings: Settings, run: RunDirectory, parts: Parts) -> None:
        self.settings, self.run = settings, run
        # Always, so that no job of a sweep inherits another's.
        torch.set_num_threads(settings.num_threads or available_cores())
        found = {"precision": chosen_precision(settings.precision, settings.device)}
        if settings.device != "cpu":
            found["device_name"] = torch.cuda.get_device_name(settings.device)
        run.set_status(RUNNING, **found)
        self.store = checkpoint_store(settings, run)
        # To the CPU, where generator states must be; each part takes the rest to its own device.
        saved = self.store.latest_valid("cpu")
        robot, clip = parts.robot, kept_motion(run, parts.clip)
        simulation = None if saved is None else saved.state["simulation"]
        self.env = build_env(settings, robot, clip, terms_of_training(settings), simulation)
        self.stages = Stages(settings.stages)
        if saved is not None and "stages" in saved.state:  # runs of earlier versions had none
            self.stages.load_state_dict(saved.state["stages"])
        self._limit_episodes()  # before any begins
        starts, terms = settings.scale.evaluate_starts, terms_of_evaluation(settings)
        self.evaluation_env = build_evaluation_env(settings, robot, clip, terms, starts)
        self.judged_split = build_judged_split(settings, self.evaluation_env.term_names)
        ppo = build_ppo(settings)
        if saved is None and settings.init_from is not None:
            print(begin_with(ppo, Path(settings.init_from)), flush=True)
        lower_layer = (parts.objective, parts.weight_optimizer)
        self.trainer = build_trainer(settings, self.env, ppo, *lower_layer)
        if saved is not None:
            self.trainer.load_state_dict(saved.state["trainer"])
        self._weigh_terms()
        self.done = 0 if saved is None else saved.iteration

    def train(self) -> Outcome:
        """Run the remaining iterations; a signal ends them after a checkpoint."""
        last = self.settings.scale.iterations
        self.run.truncate_after(self.done)
        display = make_display(self.done + 1, last)
        try:
            with _stop_signals() as stop:
                for iteration in range(self.done + 1, last + 1):
                    self._iterate(iteration, display)
                    if stop and iteration < last:
                        if self.done < iteration:
                            self._save(iteration, None)
                        return self._end(INTERRUPTED)
        finally:
            display.close()
        return self._end(FINISHED)

    def _iterate(self, iteration: int, display: Display) -> None:
        start = time.perf_counter()
        metrics = self.trainer.train_iteration((iteration - 1) / self.settings.scale.iterations)
        self._check_stability(iteration, metrics[keys.UNSTABLE_ENVS])
        metrics[keys.DISTANCE_LIMIT] = self.env.distance.value_m.item()
        sigmas = self.env.recorded.sigmas()
        metrics |= {f"{keys.SIGMA_PREFIX}{name}": sigma for name, sigma in sigmas.items()}
        self._advance_stage(iteration, metrics)
        scale = self.settings.scale
        is_last = iteration == scale.iterations
        results = []
        if is_last or iteration % scale.evaluate_every == 0:
            evaluation_start = time.perf_counter()
            results = self._evaluate()
            metrics |= mean_metrics(results)
            metrics[f"{keys.TIME_PREFIX}evaluate_s"] = time.perf_counter() - evaluation_start
        metrics[f"{keys.TIME_PREFIX}iteration_s"] = time.perf_counter() - start
        self.run.log(iteration, metrics)
        due = iteration % scale.checkpoint_every == 0 or iteration in self.store.keep_iterations
        if due or is_last or results:
            self._save(iteration, _score(results) if results else None)
        display.show(iteration, metrics)

    def _advance_stage(self, iteration: int, metrics: dict[str, float]) -> None:
        """Note the stage of this iteration, and find out that of the next."""
        if not self.stages:
            return
        metrics[keys.STAGE] = self.stages.number + 1
        if self.stages.advance(stage_facts(iteration, metrics, self.trainer.split)):
            self._limit_episodes()
            self._weigh_terms()

    def _limit_episodes(self) -> None:
        """Tell the environment what the stage says of episodes, and nothing of weights."""
        if self.stages:
            self.env.distance.hold(self.stages.present.distance_m)
            self.env.starts.keep_within(self.stages.present.start_phases)

    def _weigh_terms(self) -> None:
        if self.stages:
            self.trainer.stage_weights = self.stages.present.weights

    def _evaluate(self) -> list[EvaluationResult]:
        """The deterministic policy from each start phase to the end of the motion."""
        actor = self.trainer.ppo.actor
        with in_float32(actor):
            measured = evaluate_policy(self.evaluation_env, actor, self.judged_split)
        return [result for _, result in measured]

    def _save(self, iteration: int, score: float | None) -> None:
        self.run.flush()
        state = {
            "trainer": self.trainer.state_dict(),
            "simulation": self.env.simulation_state(),
            "stages": self.stages.state_dict(),
        }
        self.store.save(iteration, state, score)
        self.done = iteration

    def _end(self, status: str) -> Outcome:
        self.run.set_status(status)
        return Outcome(status, self.done)

    def _check_stability(self, iteration: int, unstable: float) -> None:
        states = self.env.take_unstable_states()
        limit = MAX_UNSTABLE_SHARE * self.settings.scale.num_envs
        if unstable <= limit:
            return
        path = self.run.path / f"unstable_iteration_{iteration}.npz"
        buffer = io.BytesIO()
        arrays: dict[str, Any] = {name: value.cpu().numpy() for name, value in states.items()}
        np.savez(buffer, **arrays)
        # A full disk must not hide why the run ends.
        with suppress(StorageError):
            atomic_write(path, buffer.getbuffer())
        raise UnstableSimulationError(
            f"in iteration {iteration} {unstable:.0f} of {self.settings.scale.num_envs} "
            f"simulations stopped being finite (allowed: {limit:.1f}); their last finite states "
            f"and actions are in {path}"
        )


def checkpoint_store(settings: Settings, run: RunDirectory) -> CheckpointStore:
    """The checkpoints of a run: the newest, the best, and those of the paper's snapshots.

    An extended run keeps also the snapshots and the end of the training that it was before.
    """
    former = former_totals(run.manifest)
    totals = [*former, settings.scale.iterations]
    snapshots = {max(1, round(share * total)) for share in SNAPSHOT_SHARES for total in totals}
    kept = frozenset({*snapshots, *former})
    return CheckpointStore(run.path / "checkpoints", settings.scale.keep_checkpoints, kept)


def _score(results: Sequence[EvaluationResult]) -> float:
    """The score by which the best checkpoint is chosen: minus the mean body error."""
    return -fmean(0.5 * (each.upper_body_error_m + each.lower_body_error_m) for each in results)


@contextmanager
def _stop_signals() -> Iterator[list[int]]:
    """A list that SIGINT or SIGTERM makes non-empty; a second SIGINT interrupts at once."""
    received: list[int] = []
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def note(number: int, _: FrameType | None) -> None:
        received.append(number)
        # Not print: the signal may come in the middle of one.
        os.write(1, "\nstopping after this iteration, with a checkpoint …\n".encode())
        signal.signal(signal.SIGINT, before[signal.SIGINT])

    for number in before:
        signal.signal(number, note)
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
