"""Synthetic studies with known curves: what the data would show on average can be asked for.

A value is CURVE(arm, progress) + offset of the run + noise of the iteration. The offset is normal
with standard deviation `seed_spread`, the noise a stationary AR(1) process with standard deviation
`noise` and correlation `rho` between neighbouring iterations; both are shares of the metric's
scale (its largest absolute value over training). All is independent between runs and metrics.
"""

import json
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.signal import lfilter

from analysis.commands.sources import load_studies
from analysis.data.study import Study, rows_of
from tlr_exp import keys

Curve = Callable[[np.ndarray], np.ndarray]  # progress in training (0, 1] [T] -> expected value [T]

TERMS = (  # the six of the paper's Figure 14
    *("base_height", "ang_vel_xy", "lin_vel_z"),
    *("dof_pos_limits", "dof_vel_limits", "action_smoothness"),
)
NUM_ENVS, NUM_STEPS = 8, 24
EVALUATION_METRICS = (
    *("eval/upper_body_error_m", "eval/lower_body_error_m", "eval/survival", "eval/upright"),
)


def rise(start: float, end: float, rate: float = 4.0) -> Curve:
    """From `start` to nearly `end`, exponentially."""
    return lambda progress: end + (start - end) * np.exp(-rate * progress)


def level(value: float) -> Curve:
    return lambda progress: np.full_like(progress, value)


def standard_curves(effect: float = 0.0, adaptive: bool = False) -> dict[str, Curve]:
    """Expected curves of every metric of an arm.

    `effect` makes errors smaller and episodes longer by that share at every iteration; `adaptive`
    gives weights that move away from 1, as a weight search does.
    """
    less, more = 1.0 - effect, 1.0 + effect
    curves: dict[str, Curve] = {
        keys.ENV_STEPS: level(0.0),  # replaced by the count
        keys.EPISODE_LENGTH: rise(20 * more, 200 * more),
        keys.TRAIN_UPPER_BODY_ERROR: rise(0.25 * less, 0.08 * less),
        keys.TRAIN_LOWER_BODY_ERROR: rise(0.20 * less, 0.06 * less),
        keys.TRAIN_JOINT_ERROR: rise(0.40 * less, 0.15 * less),
        keys.UNSTABLE_ENVS: level(0.0),
        keys.OBJECTIVE_BEFORE: rise(12.0, 4.0),
        keys.OBJECTIVE_AFTER: rise(3.0, 0.5) if adaptive else rise(12.0, 4.0),
        keys.OPTIMAL_SHARE: level(0.4 if adaptive else 1.0),
        keys.BOX_OPTIMAL_SHARE: rise(0.02, 0.1),
        keys.STEP_REWARD: rise(0.01, 0.06),
        "ppo/kl": level(0.01),
        "ppo/entropy": rise(30.0, 15.0),
        "ppo/action_std": rise(0.8, 0.4),
        "time/collect_s": level(1.6),
        "time/weights_s": level(0.2 if adaptive else 0.001),
        "time/advantage_s": level(0.27),
        "time/update_s": level(3.0),
        "time/landscape_s": level(0.005),
        "time/iteration_s": level(5.075 if adaptive else 4.876),
        "time/evaluate_s": level(2.0),
        "eval/upper_body_error_m": rise(0.24 * less, 0.07 * less),
        "eval/lower_body_error_m": rise(0.19 * less, 0.05 * less),
        "eval/survival": rise(0.1, 0.9),
        "eval/upright": rise(0.3, 0.95),
    }
    for index, term in enumerate(TERMS):
        curves[keys.WEIGHT_PREFIX + term] = rise(1.0, 0.2 + 0.25 * index) if adaptive else level(1)
        curves[keys.REWARD_TERM_PREFIX + term] = rise(1.0 + index, 0.1)
    for index, term in enumerate(("body_pos", "body_rot")):
        curves[keys.REWARD_TERM_PREFIX + term] = rise(0.2 + 0.1 * index, 0.8)
    return curves


def ar1(
    generator: np.random.Generator, num_runs: int, num_iterations: int, rho: float, std: float
) -> np.ndarray:
    """[num_runs, num_iterations] of stationary AR(1) noise with standard deviation `std`."""
    shocks = generator.standard_normal((num_runs, num_iterations))
    shocks[:, 1:] *= np.sqrt(1.0 - rho**2)
    return std * np.asarray(lfilter([1.0], [1.0, -rho], shocks, axis=1))


def make_study(
    generator: np.random.Generator,
    arms: Mapping[str, Mapping[str, Curve]] | Sequence[str] = ("fixed", "gwo"),
    seeds: Iterable[int] = range(5),
    iterations: int = 60,
    effect: float = 0.1,
    seed_spread: float = 0.03,
    noise: float = 0.05,
    rho: float = 0.9,
    evaluate_every: int = 10,
    scale: str = "demo",
) -> Study:
    """A finished study of `arms`: names, or names with curves that replace the standard ones.

    The first arm ("fixed" as a rule) has effect 0, all others `effect` (see `standard_curves`).
    """
    given = arms if isinstance(arms, Mapping) else {arm: {} for arm in arms}
    seeds = list(seeds)
    runs, curves = [], []
    for number, (arm, replaced) in enumerate(given.items()):
        expected = standard_curves(effect if number else 0.0, adaptive=number > 0) | dict(replaced)
        values = {
            metric: _values(generator, curve, len(seeds), iterations, seed_spread, noise, rho)
            for metric, curve in expected.items()
        }
        _make_exact(values, iterations, evaluate_every, constant_weights=arm.startswith("fixed"))
        for row, seed in enumerate(seeds):
            run = _run(arm, seed, iterations, scale)
            runs.append(run)
            columns = {metric: matrix[row] for metric, matrix in values.items()}
            curves.append(_curve(run, columns))
    frame = pd.DataFrame(runs).set_index("run")
    return Study(frame, pd.concat(curves, ignore_index=True))


STARTS_OF = {
    "survival": 1.0,
    "upright": 1.0,
    "upper_body_error_m": 0.05,
    "lower_body_error_m": 0.03,
    "joint_error_rad": 0.06,
    "latency_ms": 40.0,
    **{keys.REWARD_TERM_PREFIX + term: 0.5 + index for index, term in enumerate(TERMS)},
}


def with_starts(
    study: Study,
    generator: np.random.Generator,
    phases: int = 4,
    shift: Mapping[str, float] | None = None,
    factor: Mapping[str, float] | None = None,
    seed_spread: float = 0.05,
    phase_spread: float = 0.1,
) -> Study:
    """The study with roll-outs whose truth is known: ``STARTS_OF``, the same in both arms.

    In every arm but the first, a measure is planted `shift` larger and then `factor` times as
    large. Runs and roll-outs scatter by shares of the measure; shares of a roll-out do not.
    """
    rows = []
    for name, run in rows_of(study.runs).items():
        first = run["arm"] == study.baseline
        level_of = {
            measure: value
            if measure in ("survival", "upright")
            else value * (1 + seed_spread * generator.standard_normal())
            + (0.0 if first else (shift or {}).get(measure, 0.0))
            for measure, value in STARTS_OF.items()
        }
        for phase in range(phases):
            row: dict[str, object] = {"run": name, "start_phase": phase / phases}
            for measure, value in level_of.items():
                scatter = phase_spread * abs(value) * generator.standard_normal()
                scatter = 0.0 if measure in ("survival", "upright") else scatter
                row[measure] = (value + scatter) * (
                    1.0 if first else (factor or {}).get(measure, 1.0)
                )
            rows.append(row)
    return replace(study, starts=pd.DataFrame(rows))


def expected(curve: Curve, iterations: int) -> np.ndarray:
    """[iterations]: the average that a metric with `curve` has over infinitely many runs."""
    return curve(np.arange(1, iterations + 1) / iterations)


def _values(
    generator: np.random.Generator,
    curve: Curve,
    num_runs: int,
    iterations: int,
    seed_spread: float,
    noise: float,
    rho: float,
) -> np.ndarray:
    mean = expected(curve, iterations)
    scale = np.abs(mean).max()
    offset = seed_spread * scale * generator.standard_normal((num_runs, 1))
    return mean + offset + ar1(generator, num_runs, iterations, rho, noise * scale)


def _make_exact(
    values: dict[str, np.ndarray], iterations: int, evaluate_every: int, constant_weights: bool
) -> None:
    """Counts without noise, shares within 0 and 1, evaluations only every few iterations."""
    number = np.arange(1, iterations + 1)
    values[keys.ENV_STEPS][:] = number * NUM_ENVS * NUM_STEPS
    for metric, matrix in values.items():
        if metric in (keys.OPTIMAL_SHARE, keys.BOX_OPTIMAL_SHARE, "eval/survival", "eval/upright"):
            np.clip(matrix, 0.0, 1.0, out=matrix)
        if metric.startswith(keys.WEIGHT_PREFIX) and constant_weights:
            matrix[:] = 1.0
        if metric in EVALUATION_METRICS or metric == "time/evaluate_s":
            matrix[:, (number % evaluate_every != 0) & (number != iterations)] = np.nan


def _run(arm: str, seed: int, iterations: int, scale: str) -> dict[str, object]:
    method = arm.partition(",")[0]
    identity = f"{zlib.crc32(f'{arm} {seed} {iterations}'.encode()):08x}"  # not hash(): salted
    return {
        "run": f"{scale}-{method}-seed{seed}-{identity}",
        "run_id": f"00000000-0000-0000-0000-0000{identity}",
        "arm": arm,
        "method": method,
        "seed": seed,
        "status": "finished",
        "scale": scale,
        "motion": "gym_motion",
        "device": "cpu",
        "commit": "0123456789abcdef0123456789abcdef01234567",
        "created_at": f"2026-01-01T00:{seed % 60:02d}:00.000000+00:00",
        "identity": identity,
        "num_envs": NUM_ENVS,
        "iterations": iterations,
        "control_steps": iterations * NUM_ENVS * NUM_STEPS,
        "host": "machine",
        "cpu_model": "A Processor",
        "packages": json.dumps({"numpy": "2.4.6", "python": "3.11.7", "tlr_exp": "0.1.0"}),
        "command": f"tlr-train optimizer={method} seed={seed} scale={scale}",
        "config": json.dumps(config_of(arm, seed, iterations, scale)),
    }


def config_of(arm: str, seed: int, iterations: int, scale: str = "demo") -> dict:
    """A small resolved configuration; of "gwo, threshold_share=0.02" the key is set, too."""
    method, _, rest = arm.partition(", ")
    settings = dict(part.split("=") for part in rest.split(", ") if part)
    optimizer = {"_target_": f"tlr_exp.optimizer.{method}.{method.title()}"}
    if method != "fixed":
        optimizer |= {"lower": 0.0, "upper": 1.0, "pack_size": int(settings.get("pack_size", 30))}
    share = float(settings.get("threshold_share", 0.1))
    return {
        "env": {"motion": "gym_motion", "robot": {"mjcf": None}},
        "reward": {"objective": {"threshold_share": share}, "optimizing": {"ang_vel_xy": -0.05}},
        "optimizer": optimizer,
        "ppo": {"num_steps": NUM_STEPS, "gamma": 0.99, "hidden_sizes": [512, 256, 128]},
        "scale": {"name": scale, "num_envs": NUM_ENVS, "iterations": iterations},
        "seed": seed,
        "device": "cpu",
        "num_threads": 1,
        "study": "synthetic",
        "runs_dir": "runs",
    }


def _curve(run: Mapping[str, object], columns: Mapping[str, np.ndarray]) -> pd.DataFrame:
    length = len(next(iter(columns.values())))
    keys_of_rows = {name: [run[name]] * length for name in ("run", "arm", "seed")}
    return pd.DataFrame({**keys_of_rows, keys.ITERATION: np.arange(1, length + 1), **columns})


def load_study(*sources: Any, **choices: Any) -> Study:
    """The one study that `load_studies` finds."""
    (study,) = load_studies(*sources, **choices).values()
    return study


def write_run_directories(study: Study, root: Path) -> list[Path]:
    """Run directories below `root` as training leaves them, by the code that training uses."""
    from tlr_exp.records.run_directory import RunDirectory

    paths = []
    for name, run in rows_of(study.runs).items():
        tags = {key: run[key] for key in ("method", "scale", "device", "motion")}
        directory = RunDirectory.create(
            root / name, json.loads(run["config"]), tags, run["identity"]
        )
        curve = pd.DataFrame(study.curves[study.curves["run"] == name])
        for row in curve.to_dict("records"):
            metrics = {metric: row[metric] for metric in study.metric_names}
            directory.log(row[keys.ITERATION], metrics)
        directory.set_status(run["status"])
        paths.append(directory.path)
    return paths
