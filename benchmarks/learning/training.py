"""Trains variants, a few runs at a time, and stops those that are beaten."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.learning.curves import Curve, read_curve, run_of
from benchmarks.learning.variants import Variant

POLL_S = 5.0
# A run is stopped at an iteration at which its goal return is below this share of the best run's.
# Two seeds of the fast recipe differ by 16 % at iteration 100, by a third at 120, where episodes
# grow fastest, and by 1 % at 200: compare at 100 and 200, not between.
KEEP_SHARE = 0.75


@dataclass
class Job:
    """One run of a variant: its process while it trains, and why it was stopped."""

    variant: Variant
    seed: int
    runs_dir: Path
    process: subprocess.Popen | None = None
    stopped: str = ""
    checked: set[int] = field(default_factory=set)

    @property
    def folder(self) -> Path:
        return self.runs_dir / self.variant.name

    def curve(self) -> Curve:
        return read_curve(run_of(self.folder, self.seed))

    def start(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        log = (self.folder / f"seed{self.seed}.log").open("ab")
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-m", "tlr_exp.commands.train", *self.variant.overrides),
                *(f"seed={self.seed}", f"study={self.variant.name}", "resume=auto"),
                f"runs_dir={self.runs_dir}",
            ],
            stdout=log,
            stderr=subprocess.STDOUT,
        )
        log.close()

    def stop(self, reason: str) -> None:
        """Ask the run to end with a checkpoint, so that it can be gone on with."""
        if self.process is not None and not self.stopped:
            self.stopped = reason
            self.process.send_signal(signal.SIGINT)


def train(
    variants: Sequence[Variant],
    seeds: Sequence[int],
    runs_dir: Path,
    until: int,
    check_at: Sequence[int],
    parallel: int,
) -> None:
    """Train every variant with every seed up to iteration ``until``, ``parallel`` at a time.

    Seeds are outermost, so that all variants are compared early. Runs go on where an earlier call
    left them.
    """
    waiting = [Job(variant, seed, runs_dir) for seed in seeds for variant in variants]
    jobs, running = list(waiting), []
    try:
        while waiting or running:
            while waiting and len(running) < parallel:
                running.append(waiting.pop(0))
                running[-1].start()
            time.sleep(POLL_S)
            for job in running:
                judge(job, jobs, until, check_at)
            for job in [job for job in running if job.process and job.process.poll() is not None]:
                running.remove(job)
                print(_line(job), flush=True)
    finally:
        for job in running:
            job.stop("interrupted")
        for job in running:
            if job.process:
                job.process.wait()


def judge(job: Job, jobs: Sequence[Job], until: int, check_at: Sequence[int]) -> None:
    """Stop the run at ``until``, or where it is beaten at an iteration of ``check_at``."""
    curve = job.curve()
    if curve.iterations >= until:
        job.stop(f"reached iteration {until}")
    for iteration in check_at:
        if iteration in job.checked or curve.iterations < iteration:
            continue
        job.checked.add(iteration)
        best = max(_returns_at(jobs, iteration))
        mine = curve.goal_return_at(iteration)
        if mine < KEEP_SHARE * best:
            job.stop(f"beaten at iteration {iteration}: goal return {mine:.2f} against {best:.2f}")


def _returns_at(jobs: Sequence[Job], iteration: int) -> Iterator[float]:
    for curve in (job.curve() for job in jobs):
        if curve.iterations >= iteration:
            yield curve.goal_return_at(iteration)


def _line(job: Job) -> str:
    curve = job.curve()
    return f"{job.variant.name} seed {job.seed}: {curve.summary()}; {job.stopped or 'ended'}"
