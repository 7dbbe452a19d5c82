"""The Optimal Stochastic Process Optimizer (Xu and Xu, IEEE Access 2021), which the paper names.

It follows the authors' published application, step by step: `ospo_steps.py` holds the steps,
`ospo_search.py` their order. Where that leaves something open, or where it is adapted, this is what
was chosen:

- It is made for 40 000 evaluations. At 1530, its 100 start points with ten neighbours each would
  take 1100; so their number is a setting, 10 by default, as are the sizes of the population.
- The search runs in the unit cube in float64; all lengths are shares of the box.
- The start points lie on the diagonal, as published. So a function whose minimum has equal
  coordinates, as many a test function, is easier for OSPO than others.
- Step 3 jumps from the best elite with the three best; the ten trials are evaluated together. Each
  is stretched with probability 1/2, by U(0.5, 1.5) for each coordinate.
- What steps 3 and 5 find joins the population, from which the worst drop out.
- The local elite is the best of the path so far. Step 5 extrapolates from the latest earlier
  local elite of the path whose value is worse.
- The Gaussian local search (step 9) takes rounds of ten points around the best. A round that finds
  better doubles the standard deviation, up to a tenth of the box, another halves it; it begins at
  the floor of step 8. At the end of a path it has as many evaluations as the population; the last
  one has all that is left.
- Equal values: `tie_break` decides wherever one position is put before another.
"""

from dataclasses import dataclass

from tlr_exp.config.checks import check_at_least
from tlr_exp.optimizer.base import ChosenWeights
from tlr_exp.optimizer.ospo_search import OspoSettings, ospo_search
from tlr_exp.optimizer.search import SearchResult, TieBreak
from tlr_exp.reward.objectives import WeightFunction


@dataclass(kw_only=True, eq=False)
class Ospo(ChosenWeights):
    """Weights that minimise the objective, by OSPO in every iteration.

    Attributes:
        population: samples of an inner iteration, at least `elites`.
        elites: the best of them, at least 3, of which a jump is made.
        inner_iterations: of a path, at least 1.
        start_points: start points on the diagonal, at least 1.
    """

    budget: int
    population: int
    elites: int
    inner_iterations: int
    start_points: int
    lower: float
    upper: float
    tie_break: TieBreak

    def __post_init__(self) -> None:
        super().__post_init__()
        self.set_box(self.lower, self.upper, self.tie_break)
        check_at_least("budget", self.budget, 1)
        check_at_least("elites", self.elites, 3)
        check_at_least("population, from which elites are taken,", self.population, self.elites)
        check_at_least("inner_iterations", self.inner_iterations, 1)
        check_at_least("start_points", self.start_points, 1)

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """One OSPO search."""
        settings = OspoSettings(
            self.population, self.elites, self.inner_iterations, self.start_points
        )
        return ospo_search(objective_fn, self.task, self.budget, settings)
