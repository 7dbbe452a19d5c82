"""Shows a run while it trains: a live panel, or plain lines without a terminal."""

import sys
import time
from collections.abc import Mapping
from typing import Protocol

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table

from tlr_exp import keys


class Display(Protocol):
    """Shows the iterations of a run."""

    def show(self, iteration: int, metrics: Mapping[str, float]) -> None: ...

    def close(self) -> None: ...


class Pace:
    """Speed and remaining time of a run, from the iterations of this session alone."""

    def __init__(self, first: int, last: int) -> None:
        self.first, self.last = first, last
        self.start = time.monotonic()
        self.first_env_steps: float | None = None

    def steps_per_second(self, env_steps: float, iteration: int) -> float:
        """Control steps a second since the session's start."""
        if self.first_env_steps is None:
            per_iteration = env_steps / iteration
            self.first_env_steps = env_steps - per_iteration
        return (env_steps - self.first_env_steps) / self._elapsed_s()

    def eta_s(self, iteration: int) -> float:
        """Seconds until the last iteration at the mean pace so far."""
        done = iteration - self.first + 1
        return (self.last - iteration) * self._elapsed_s() / done

    def _elapsed_s(self) -> float:
        return max(time.monotonic() - self.start, 1e-9)


class PlainDisplay:
    """One line an iteration; at most one in ``interval_s`` seconds, and the last one always."""

    def __init__(self, first: int, last: int, interval_s: float = 2.0) -> None:
        self.pace = Pace(first, last)
        self.last = last
        self.interval_s = interval_s
        self.shown_at = -float("inf")

    def show(self, iteration: int, metrics: Mapping[str, float]) -> None:
        speed = self.pace.steps_per_second(metrics[keys.ENV_STEPS], iteration)
        now = time.monotonic()
        if now - self.shown_at < self.interval_s and iteration != self.last:
            return
        self.shown_at = now
        weights = " ".join(f"{name}={value:.2f}" for name, value in _weights(metrics).items())
        print(
            f"iteration {iteration}/{self.last}  {speed:,.0f} steps/s  "
            f"ETA {clock(self.pace.eta_s(iteration))}  "
            + "  ".join([*_headlines(metrics), f"weights {weights}"]),
            flush=True,
        )

    def close(self) -> None:
        pass


class LiveDisplay:
    """A panel that is redrawn in place: progress bar, headline numbers, weights."""

    def __init__(self, first: int, last: int, console: Console) -> None:
        self.pace = Pace(first, last)
        self.bar = Progress(
            TextColumn("iteration"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[speed]}"),
            TextColumn("ETA {task.fields[eta]}"),
            console=console,
        )
        self.task = self.bar.add_task("", total=last, completed=first - 1, speed="", eta="…")
        self.live = Live(self.bar, console=console, refresh_per_second=4)
        self.live.start()

    def show(self, iteration: int, metrics: Mapping[str, float]) -> None:
        speed = self.pace.steps_per_second(metrics[keys.ENV_STEPS], iteration)
        self.bar.update(
            self.task,
            completed=iteration,
            speed=f"{speed:,.0f} steps/s",
            eta=clock(self.pace.eta_s(iteration)),
        )
        self.live.update(Group(self.bar, *_headlines(metrics), _weights_table(metrics)))

    def close(self) -> None:
        self.live.stop()


def make_display(first: int, last: int) -> Display:
    """A live panel on a terminal, plain lines elsewhere."""
    if sys.stdout.isatty():
        return LiveDisplay(first, last, Console())
    return PlainDisplay(first, last)


def _headlines(metrics: Mapping[str, float]) -> list[str]:
    return [
        f"episode length {metrics[keys.EPISODE_LENGTH]:.0f} steps",
        f"error upper {metrics[keys.TRAIN_UPPER_BODY_ERROR]:.3f} m"
        f" lower {metrics[keys.TRAIN_LOWER_BODY_ERROR]:.3f} m",
        f"J {metrics[keys.OBJECTIVE_BEFORE]:.2f} -> {metrics[keys.OBJECTIVE_AFTER]:.2f}",
    ]


def _weights(metrics: Mapping[str, float]) -> dict[str, float]:
    prefix = keys.WEIGHT_PREFIX
    return {n.removeprefix(prefix): value for n, value in metrics.items() if n.startswith(prefix)}


def _weights_table(metrics: Mapping[str, float]) -> Table:
    table = Table(title="weights of the lower layer", title_justify="left")
    weights = _weights(metrics)
    for name in weights:
        table.add_column(name, justify="right")
    table.add_row(*(f"{value:.2f}" for value in weights.values()))
    return table


def clock(seconds: float) -> str:
    """Hours, minutes and seconds as 1:02:03 or 2:03."""
    minutes, second = divmod(round(seconds), 60)
    hours, minute = divmod(minutes, 60)
    return f"{hours}:{minute:02}:{second:02}" if hours else f"{minute}:{second:02}"
