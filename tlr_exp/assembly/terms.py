"""The reward terms that an environment records, with their order and constants.

Whoever reads recorded terms asks the environment for their names (``TrackingEnv.term_names``).
"""

from collections.abc import Mapping

from tlr_exp.config.settings import Settings
from tlr_exp.env.terms import PAPER_LOWER_LAYER, TERMS

LIMIT_MARGIN = 0.1  # epsilon of Table 1, for limit terms that only an evaluation reports

Terms = Mapping[str, Mapping[str, float]]
"""Names of terms, in order, and the constants that each takes."""


def terms_of_training(settings: Settings) -> Terms:
    """Those of the reward: the goal's, then those whose weight is adapted, as configured."""
    reward = settings.reward
    return {name: reward.parameters.get(name, {}) for name in (*reward.goal, *reward.optimizing)}


def terms_of_evaluation(settings: Settings) -> Terms:
    """Those of the training, then every lower-layer term of the paper that its reward has not."""
    paper = {name: TERMS[name].constants for name in PAPER_LOWER_LAYER}
    margins = {name: dict.fromkeys(names, LIMIT_MARGIN) for name, names in paper.items()}
    ours = terms_of_training(settings)
    return {**ours, **{name: margins[name] for name in margins if name not in ours}}
