"""The searches that are compared, each with the same budget and from its own seed."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np
from hydra import compose, initialize_config_module
from mealpy import FloatVar
from mealpy.swarm_based.GWO import OriginalGWO
from omegaconf import DictConfig, OmegaConf
from scipy.optimize import differential_evolution
from torch import Tensor, from_numpy

from benchmarks.optimizers.problems import Problem
from tlr_exp.config.components import instantiate
from tlr_exp.config.load import CONFIG_PATH
from tlr_exp.reward.objectives import Objective, RankDeviation

PACK_SIZE, ITERATIONS = 30, 50
BUDGET = PACK_SIZE * (ITERATIONS + 1)

OURS = (
    *("gwo", "pso", "differential_evolution", "cma_es", "ospo", "effective_dimension"),
    "random_search",
)
Search = Callable[[Problem, int], float]


@cache
def _settings(choice: str) -> DictConfig:
    with initialize_config_module(CONFIG_PATH.removeprefix("pkg://"), version_base="1.3"):
        return compose("config", [f"optimizer={choice}"]).optimizer


def configured(
    choice: str, num_terms: int, objective: Objective, seed: int, **settings: Any
) -> Any:  # a WeightOptimizer, most of them with more
    """An optimizer of `conf/optimizer`, in which `settings` replace those of its file."""
    config = OmegaConf.merge(_settings(choice), settings)
    return instantiate(
        "optimizer",
        OmegaConf.to_container(config, resolve=True),  # type: ignore[arg-type]
        num_terms=num_terms,
        objective=objective,
        seed=seed,
        device="cpu",
    )


def ours(choice: str) -> Search:
    """An optimizer of `conf/optimizer` with its own settings; the error that it reaches."""

    def search(problem: Problem, seed: int) -> float:
        settings = box = {"lower": problem.lower, "upper": problem.upper}
        if "inner" in _settings(choice):
            settings = {"inner": box, "rest": problem.upper}
        optimizer = configured(choice, problem.dims, RankDeviation(0.1), seed, **settings)
        return optimizer.search(problem.value).value

    return search


def mealpy_gwo(problem: Problem, seed: int) -> float:
    """The original GWO of mealpy."""
    model = OriginalGWO(epoch=ITERATIONS, pop_size=PACK_SIZE)
    bounds = FloatVar(lb=(problem.lower,) * problem.dims, ub=(problem.upper,) * problem.dims)
    settings = {
        "bounds": bounds,
        "minmax": "min",
        "obj_func": lambda x: problem.value(from_numpy(x)[None]).item(),
        "log_to": None,
        # Given, because the library would evaluate a position to count the values.
        "_n_objs": 1,
        "obj_weights": np.ones(1),
    }
    return float(model.solve(settings, seed=seed).target.fitness)


def scipy_differential_evolution(problem: Problem, seed: int) -> float:
    """SciPy's differential evolution with its own strategy, without its final gradient descent."""
    rng = np.random.default_rng(seed)

    def values(x: np.ndarray) -> np.ndarray:  # [dims, n]
        columns: Tensor = problem.value(from_numpy(np.ascontiguousarray(x.T)))
        return columns.numpy()

    found = differential_evolution(
        values,
        [(problem.lower, problem.upper)] * problem.dims,
        init=rng.uniform(problem.lower, problem.upper, (PACK_SIZE, problem.dims)),
        maxiter=ITERATIONS,
        tol=0.0,
        polish=False,
        updating="deferred",
        vectorized=True,
        rng=rng,
    )
    return float(found.fun)


def all_searches() -> Mapping[str, Search]:
    """By the name that tables show."""
    return {
        **{name: ours(name) for name in OURS},
        "mealpy GWO": mealpy_gwo,
        "SciPy DE": scipy_differential_evolution,
    }
