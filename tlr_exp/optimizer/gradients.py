"""What optimizers share that weigh terms by how these would have the policy change."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

from torch import Tensor

from tlr_exp.optimizer.base import ChosenWeights
from tlr_exp.optimizer.protocol import PolicyGradients, TrainingProgress, no_policy
from tlr_exp.optimizer.search import SearchResult, unsearched
from tlr_exp.reward.objectives import WeightFunction


@dataclass(kw_only=True, eq=False)
class GradientWeights(ChosenWeights):
    """Weights that `weigh` chooses by the policy gradients of the iteration. J has no say.

    The gradients are computed in `search`, not before: behind a gate that is closed they cost
    nothing.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        self.term_names: tuple[str, ...] = ()
        self._policy_gradients = no_policy

    def observe(self, progress: TrainingProgress) -> None:
        """Take note of where the gradients of this iteration are to be had."""
        self.term_names = tuple(progress.mean_terms)
        self._policy_gradients = progress.policy_gradients

    @abstractmethod
    def weigh(self, gradients: PolicyGradients) -> tuple[Tensor, Mapping[str, float]]:
        """Weights [num_terms], and what is to be recorded besides, by name."""

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """The weights that the gradients ask for, whatever their J.

        Raises:
            UserError: it was told of no policy.
        """
        weights, details = self.weigh(self._policy_gradients())
        self._policy_gradients = no_policy  # the policy learns now, and these are gone
        return unsearched(weights.to(self.last_weights), objective_fn, details)

    def by_term(self, what: str, values: Tensor) -> dict[str, float]:
        """Numbers to record, one for each term [num_terms]: `what/NAME`."""
        pairs = zip(self.term_names, values.tolist(), strict=True)
        return {f"{what}/{name}": value for name, value in pairs}

    def comparison_by_term(self, compared: "Comparison") -> dict[str, float]:
        """What to record of how the gradients compare: `gradient_ratio` and `gradient_cosine`."""
        ratios = self.by_term("gradient_ratio", compared.ratio)
        return {**ratios, **self.by_term("gradient_cosine", compared.cosine)}


@dataclass(frozen=True)
class Comparison:
    """How the gradients of the terms at weight 1 compare with the goal's, on the CPU.

    Attributes:
        ratio: of their norm to the goal's norm [num_terms]; infinite or NaN where that is 0.
        cosine: of the angle between them [num_terms]; NaN where one of both is 0.
    """

    ratio: Tensor
    cosine: Tensor

    @classmethod
    def of(cls, gradients: PolicyGradients) -> "Comparison":
        goal, terms = gradients.goal.double(), gradients.terms.double()
        goal_norm, norms = goal.norm(), terms.norm(dim=1)
        cosine = (terms @ goal) / (norms * goal_norm)
        return cls((norms / goal_norm).cpu(), cosine.cpu())
