"""The benchmark of the weight optimizers compares what it says, with the same budget."""

import dataclasses

import pytest
import torch
from torch import Tensor

from benchmarks.optimizers import report
from benchmarks.optimizers.measure import Measurement, Summary, measure, summarise
from benchmarks.optimizers.problems import FUNCTIONS, recorded_landscapes, shifted_functions
from benchmarks.optimizers.searches import BUDGET, all_searches


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_minimum_of_every_function_is_zero_at_the_origin(name: str) -> None:
    positions = torch.randn(200, 7, generator=torch.Generator().manual_seed(0)).double()
    positions[0] = 0.0
    values = FUNCTIONS[name](positions)
    assert values[0].item() == pytest.approx(0.0, abs=1e-12)
    assert (values[1:] > 0.0).all()


def test_the_minima_lie_elsewhere_for_every_seed() -> None:
    first, other = shifted_functions(0)[0], shifted_functions(1)[0]
    origin = torch.zeros(1, first.dims)
    assert 1.0 < first.value(origin).item() < 6 * 9
    assert first.value(origin).item() != other.value(origin).item()
    assert first.value(origin).item() == shifted_functions(0)[0].value(origin).item()


def test_on_the_recorded_landscapes_something_can_be_lost() -> None:
    for problem in recorded_landscapes():
        assert problem.value(torch.zeros(1, problem.dims)).item() == 0.0
        assert problem.value(torch.ones(1, problem.dims)).item() > 0.0


@pytest.mark.parametrize("name", all_searches())
def test_every_search_has_the_same_budget(name: str) -> None:
    problem = shifted_functions(0)[0]
    positions: list[Tensor] = []

    def counted(x: Tensor) -> Tensor:
        positions.append(x.clone())
        return problem.value(x)

    error = all_searches()[name](dataclasses.replace(problem, value=counted), 0)
    asked = torch.cat([part.double() for part in positions])
    assert error == problem.value(asked).min().item()
    assert (asked.abs() <= 5.0).all()
    if name == "effective_dimension":
        assert BUDGET - 30 < len(asked) <= BUDGET
    else:
        assert len(asked) == BUDGET


def test_errors_on_recorded_landscapes_are_from_the_best_that_was_found() -> None:
    found = [
        Measurement("J, a", "p", search, seed, error, 0.5)
        for search, errors in {"x": (3.0, 5.0, 9.0), "y": (2.0, 2.0, 4.0)}.items()
        for seed, error in enumerate(errors)
    ]
    x, y = summarise(found)
    assert (x.median, x.lower_quartile, x.upper_quartile, x.seeds) == (3.0, 2.0, 5.0, 3)
    assert (y.median, y.seconds) == (0.0, 0.5)
    (plain,) = summarise([Measurement("6 dimensions", "p", "x", 0, 3.0, 0.5)])
    assert plain.median == 3.0


def test_a_measurement_of_all_has_every_cell() -> None:
    found = measure({"middle": lambda problem, _: problem.value(_middle(problem)).item()}, [3])
    assert len(found) == len({(one.group, one.problem) for one in found})
    assert {one.seed for one in found} == {3}


def _middle(problem) -> Tensor:
    return torch.full((1, problem.dims), 0.5 * (problem.lower + problem.upper))


SUMMARIES = [
    Summary("6 dimensions", "sphere", "gwo", 3, 0.5, 1.0, 2.0, 0.010),
    Summary("6 dimensions", "sphere", "pso", 3, 0.5, 0.25, 2.0, 0.020),
]


def test_the_table_marks_the_smallest_error() -> None:
    lines = report.tables(SUMMARIES).splitlines()
    assert "| gwo | 1 | 10 |" in lines
    assert "| pso | **0.25** | 20 |" in lines
    assert report.mean_ranks(SUMMARIES) == {"gwo": 2.0, "pso": 1.0}


def test_the_page_keeps_what_stands_around_the_table() -> None:
    page = f"before\n{report.BEGIN}\nold\n{report.END}\nafter\n"
    assert report.insert(page, "new") == f"before\n{report.BEGIN}\n\nnew\n\n{report.END}\nafter\n"
    with pytest.raises(ValueError, match="no marks"):
        report.insert("before", "new")
