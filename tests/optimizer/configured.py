"""Optimizers with the settings of their files in `conf/optimizer`, where alone these stand."""

import functools
from typing import Any

from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from tlr_exp.config.components import instantiate
from tlr_exp.reward.objectives import Objective, RankDeviation


def make(
    choice: str,
    *overrides: str,
    num_terms: int = 5,
    objective: Objective | None = None,
    seed: int = 0,
    **settings: Any,
) -> Any:  # a WeightOptimizer, most of them with more
    """The optimizer of `conf/optimizer`, in which `settings` replace those of its file."""
    config = OmegaConf.merge(_composed(choice, *overrides), settings)
    return instantiate(
        "optimizer",
        OmegaConf.to_container(config),  # type: ignore[arg-type]
        num_terms=num_terms,
        objective=objective or RankDeviation(0.1),
        seed=seed,
        device="cpu",
    )


@functools.cache
def _composed(choice: str, *overrides: str) -> Any:
    with initialize_config_module("tlr_exp.conf", version_base="1.3"):
        config = compose("config", [f"optimizer={choice}", *overrides])
    return OmegaConf.to_container(config.optimizer, resolve=True)
