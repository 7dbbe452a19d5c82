"""ASAP's penalty curriculum on top of another optimizer's weights.

ASAP multiplies all penalties by its curriculum, whatever their coefficients. The paper adopts
ASAP's settings and does not say that it drops this one.
"""

from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor

from tlr_exp.errors import UserError
from tlr_exp.optimizer.around import Reweighted
from tlr_exp.optimizer.curriculum import PenaltyCurriculum


@dataclass(kw_only=True, eq=False)
class UnderCurriculum(Reweighted):
    """The weights of `inner` times the scale of a penalty curriculum.

    Attributes:
        curriculum: makes the `PenaltyCurriculum` from num_terms, objective, seed and device.
        growing: the curriculum that was made.
    """

    curriculum: Callable[..., PenaltyCurriculum]

    def __post_init__(self) -> None:
        super().__post_init__()
        self.growing = self.made(self.curriculum)
        if not isinstance(self.growing, PenaltyCurriculum):
            raise UserError(
                f"curriculum makes a {type(self.growing).__name__}, which has no scale: use "
                "optimizer@optimizer.curriculum=curriculum"
            )
        self.parts["curriculum"] = self.growing

    def changed(self, weights: Tensor) -> Tensor:
        """The weights times the present scale."""
        return weights * self.growing.scale.to(weights)
