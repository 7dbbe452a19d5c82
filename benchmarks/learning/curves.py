"""What runs of a variant left behind: their curves, and a picture of them."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import yaml

from tlr_exp import keys
from tlr_exp.robot.timing import CONTROL_DT_S

WINDOW = 20  # iterations over which a value is averaged
COLUMNS = {
    "env_steps": keys.ENV_STEPS,
    "episode_steps": keys.EPISODE_LENGTH,
    "upper_m": keys.TRAIN_UPPER_BODY_ERROR,
    "lower_m": keys.TRAIN_LOWER_BODY_ERROR,
    "seconds": f"{keys.TIME_PREFIX}iteration_s",
}
SAVED = ("env_steps", "episode_steps", "upper_m", "lower_m", "goal_return", "hours")


@dataclass(frozen=True)
class Curve:
    """One run: an array [iterations] for each column, and the goal reward of an episode."""

    columns: Mapping[str, np.ndarray]

    @property
    def iterations(self) -> int:
        return len(self.columns["env_steps"])

    def goal_return_at(self, iteration: int) -> float:
        """Mean goal reward of an episode over the last iterations up to ``iteration``."""
        return float(self.columns["goal_return"][max(0, iteration - WINDOW) : iteration].mean())

    def summary(self) -> str:
        if not self.iterations:
            return "nothing yet"
        last = {name: values[-WINDOW:].mean() for name, values in self.columns.items()}
        return (
            f"{self.iterations} iterations, episode {last['episode_steps']:.0f} steps, "
            f"upper {100 * last['upper_m']:.1f} cm, lower {100 * last['lower_m']:.1f} cm, "
            f"goal return {last['goal_return']:.2f}"
        )


def run_of(folder: Path, seed: int) -> Path | None:
    """The run directory of that seed in a variant's folder, if it has begun."""
    found = [path.parent for path in folder.glob(f"*-seed{seed}-*/metrics.jsonl")]
    return found[0] if found else None


def read_curve(run: Path | None) -> Curve:
    """The curve of a run directory; empty where there is none."""
    rows: list[dict] = []
    goal: Mapping[str, float] = {}
    if run is not None:
        lines = (run / "metrics.jsonl").read_text(encoding="utf-8").splitlines()
        # The last line of a run that is training may be half written.
        rows = [json.loads(line) for line in lines if line.endswith("}")]
        rows = [row.get("metrics", row) for row in rows]
        goal = yaml.safe_load((run / "config.yaml").read_text(encoding="utf-8"))["reward"]["goal"]
    columns = {name: np.array([row[key] for row in rows]) for name, key in COLUMNS.items()}
    per_step = np.array(
        [sum(c * row[keys.REWARD_TERM_PREFIX + term] for term, c in goal.items()) for row in rows]
    )
    columns["goal_return"] = per_step * CONTROL_DT_S * columns["episode_steps"]
    columns["hours"] = np.cumsum(columns.pop("seconds")) / 3600
    return Curve(columns)


def save(curves: Mapping[tuple[str, int], Curve], path: Path) -> None:
    """Write all curves as one CSV: a row an iteration, named by variant and seed."""
    frames = [
        pd.DataFrame({"variant": variant, "seed": seed, **curve.columns}).assign(
            iteration=lambda frame: np.arange(1, len(frame) + 1)
        )
        for (variant, seed), curve in curves.items()
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    pd.concat(frames).to_csv(path, index=False, float_format="%.6g")


def load(path: Path) -> dict[tuple[str, int], Curve]:
    """The curves of a file that ``save`` wrote, by variant and seed, in its order."""
    frame = pd.read_csv(path)
    return {
        (str(variant), int(seed)): Curve({name: rows[name].to_numpy() for name in SAVED})
        for (variant, seed), rows in frame.groupby(["variant", "seed"], sort=False)
    }


def draw(curves: Mapping[tuple[str, int], Curve], path: Path) -> None:
    """Errors and episode length of every variant against control steps and against hours."""
    panels = {
        "episode_steps": ("mean episode (control steps)", 1.0),
        "upper_m": ("upper-body error (cm)", 100.0),
        "lower_m": ("lower-body error (cm)", 100.0),
    }
    axes_names = {"env_steps": ("control steps (million)", 1e-6), "hours": ("minutes", 60.0)}
    figure, grid = plt.subplots(2, 3, figsize=(13, 7.5), layout="constrained")
    names = list(dict.fromkeys(name for name, _ in curves))
    colors = dict(zip(names, plt.get_cmap("tab20").colors * 2, strict=False))
    for row, (x_name, (x_label, x_scale)) in enumerate(axes_names.items()):
        for column, (y_name, (y_label, y_scale)) in enumerate(panels.items()):
            axes = grid[row, column]
            for (name, _), curve in curves.items():
                x, y = curve.columns[x_name], _smooth(curve.columns[y_name])
                axes.plot(x_scale * x, y_scale * y, color=colors[name], linewidth=1.2)
            axes.set(xlabel=x_label, ylabel=y_label)
            axes.set_ylim(bottom=0)
            axes.grid(alpha=0.3)
    handles = [plt.Line2D([], [], color=color, label=name) for name, color in colors.items()]
    figure.legend(handles=handles, loc="outside right center", fontsize="small", frameon=False)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _smooth(values: np.ndarray) -> np.ndarray:
    """Running mean over the last ten iterations."""
    sums = np.cumsum(np.concatenate(([0.0], values)))
    starts = np.maximum(0, np.arange(len(values)) - 9)
    ends = np.arange(1, len(values) + 1)
    return (sums[ends] - sums[starts]) / (ends - starts)
