"""The objective and the weight optimizer of a run, from settings."""

from tlr_exp.assembly.seeds import Seeds
from tlr_exp.config.components import instantiate
from tlr_exp.config.settings import Settings
from tlr_exp.optimizer.protocol import WeightOptimizer
from tlr_exp.reward.objectives import Objective


def build_lower_layer(settings: Settings) -> tuple[Objective, WeightOptimizer]:
    """The objective, and the optimizer of its weights; both check their settings themselves.

    The optimizer works on the CPU, where its small tensors are fastest.

    Raises:
        ConfigError: one of them refuses its settings, or lacks a package.
    """
    objective = instantiate("reward.objective", settings.reward.objective)
    weight_optimizer = instantiate(
        "optimizer",
        settings.optimizer,
        num_terms=len(settings.reward.optimizing),
        objective=objective,
        seed=Seeds.of(settings.seed).weights,
        device="cpu",
    )
    return objective, weight_optimizer
