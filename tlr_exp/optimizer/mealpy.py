"""Any optimizer of the library mealpy, by the name of its class."""

import difflib
import inspect
import random
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tlr_exp.config.checks import check_at_least
from tlr_exp.errors import UserError
from tlr_exp.optimizer.base import ChosenWeights
from tlr_exp.optimizer.search import BudgetSpent, SearchResult, Tally, TieBreak
from tlr_exp.reward.objectives import WeightFunction

_NUM_SEEDS = 2**32  # what NumPy's global generator takes
# Their samplers take a seed from the operating system: no run could be repeated.
_UNSEEDED = ("OriginalPSS",)
_OWN_ARGUMENTS = {"self", "epoch", "pop_size", "kwargs"}  # of a class, besides its parameters


@dataclass(kw_only=True, eq=False)
class MealpySearch(ChosenWeights):
    """Weights that minimise the objective, by an optimizer of mealpy in every iteration.

    Whatever the algorithm asks for, at most `budget` positions are evaluated: some evaluate more
    than one position per member and epoch and are stopped, some stop before. What was spent is
    counted. The library evaluates one position at a time, and ranks equal values in its own way;
    `tie_break` decides which of the best ones is returned.

    The library is seeded by this optimizer's generator. The few of its algorithms that draw from
    the global generators of NumPy and Python find them seeded as well, and these are put back
    afterwards.

    Attributes:
        algorithm: name of a class of mealpy, such as "OriginalWOA".
        pack_size: members of its population (mealpy: pop_size), at least 5.
        iterations: its epochs; many algorithms narrow their moves towards the last one.
        parameters: further arguments of the class; what is left out has the library's default.

    Raises:
        UserError: mealpy is not installed, has no such class or one that cannot be seeded, or
            refuses a setting.
    """

    algorithm: str
    budget: int
    pack_size: int
    iterations: int
    parameters: Mapping[str, Any]
    lower: float
    upper: float
    tie_break: TieBreak

    def __post_init__(self) -> None:
        super().__post_init__()
        self.set_box(self.lower, self.upper, self.tie_break)
        check_at_least("budget", self.budget, 1)
        check_at_least("pack_size", self.pack_size, 5)
        check_at_least("iterations", self.iterations, 1)
        self.kind = _find(self.algorithm)
        _check_parameters(self.kind, self.parameters)
        self.arguments = {"epoch": self.iterations, "pop_size": self.pack_size, **self.parameters}
        self._new_model()

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """One search with the settings of this optimizer."""
        lower, upper = self.task.lower, self.task.upper
        tally = Tally(objective_fn, self.task, self.budget)
        evaluated: list[Tensor] = []
        values: list[float] = []

        def value_of(position: np.ndarray) -> float:
            evaluated.append(torch.from_numpy(position)[None].to(lower))
            values.append(tally(evaluated[-1]).item())
            return values[-1]

        draw = torch.randint(_NUM_SEEDS, (1,), generator=self.generator, device=self.device)
        seed = int(draw.item())
        with _global_generators(seed), suppress(BudgetSpent):
            self._new_model().solve(self._problem(value_of), seed=seed)
        last = slice(max(0, len(values) - self.pack_size), len(values))
        pack = torch.cat(evaluated[last]).clamp(lower, upper)
        return tally.result(pack, torch.tensor(values[last], dtype=torch.float64))

    def _new_model(self) -> Any:
        try:
            return self.kind(**self.arguments)
        except (TypeError, ValueError) as error:
            raise UserError(f"mealpy's {self.kind.__name__}: {error}") from error

    def _problem(self, value_of: Callable[[np.ndarray], float]) -> dict[str, Any]:
        from mealpy import FloatVar

        lower: Any = self.task.lower.tolist()  # one for each weight, which its types leave out
        upper: Any = self.task.upper.tolist()
        return {
            "obj_func": value_of,
            "bounds": FloatVar(lb=lower, ub=upper),
            "minmax": "min",
            "log_to": None,
            # Given, because the library would evaluate a position to count the values.
            "_n_objs": 1,
            "obj_weights": np.ones(1),
        }


def _find(name: str) -> type:
    try:
        import mealpy
    except ImportError as error:
        raise UserError(
            "the optimizer mealpy needs the package mealpy, which is not installed: "
            "pip install -e '.[mealpy]'"
        ) from error
    known = mealpy.get_all_optimizers(verbose=False)
    if name in _UNSEEDED:
        raise UserError(f"mealpy's {name} cannot be seeded, so that no run with it repeats")
    if name in known:
        return known[name]
    by_lower_case = {candidate.lower(): candidate for candidate in known}
    close = difflib.get_close_matches(name.lower(), by_lower_case, n=5, cutoff=0.5)
    similar = ", ".join(by_lower_case[match] for match in close)
    raise UserError(
        f"mealpy has no optimizer {name!r}; "
        + (f"similar: {similar}" if similar else f"it has: {', '.join(sorted(known))}")
    )


def _check_parameters(algorithm: type, parameters: Mapping[str, Any]) -> None:
    """Refuse arguments that the class does not name: it would take and ignore them."""
    known = [n for n in inspect.signature(algorithm).parameters if n not in _OWN_ARGUMENTS]
    unknown = [name for name in parameters if name not in known]
    if unknown:
        raise UserError(
            f"mealpy's {algorithm.__name__} has no parameter {', '.join(unknown)}; it has: "
            f"{', '.join(known) or 'none'}"
        )


@contextmanager
def _global_generators(seed: int) -> Iterator[None]:
    """Seed the global generators of NumPy and Python, and put them back afterwards."""
    numpy_state, python_state = np.random.get_state(), random.getstate()  # noqa: NPY002
    np.random.seed(seed)  # noqa: NPY002
    random.seed(seed)
    try:
        yield
    finally:
        np.random.set_state(numpy_state)  # noqa: NPY002
        random.setstate(python_state)
