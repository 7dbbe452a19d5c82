"""Screening by elementary effects, and the search that it narrows."""

from typing import Any

import configured
import pytest
import torch
from landscapes import Recorder, constant
from torch import Tensor

from tlr_exp.optimizer.effective_dimension import (
    EffectiveDimension,
    mean_absolute_effects,
    morris_trajectories,
)

NUM_TERMS = 6
SCREENING = 10 * (NUM_TERMS + 1)


def make(choice: str = "gwo", **settings: Any) -> EffectiveDimension:
    inner = f"optimizer@optimizer.inner={choice}"
    return configured.make("effective_dimension", inner, num_terms=NUM_TERMS, **settings)


def two_matter(x: Tensor) -> Tensor:
    """Only coordinates 1 and 4 matter; minimum 0 at 0.3 and 0.7."""
    return ((x[:, 1] - 0.3).square() + 2.0 * (x[:, 4] - 0.7).square()).double()


def test_every_walk_moves_each_coordinate_once_by_one_step() -> None:
    walks = morris_trajectories(5, 40, 4, torch.Generator().manual_seed(0))
    assert walks.points.shape == (40, 6, 5)
    # Four levels, 0 to 1; a step is 4 / (2 * 3) = 2 / 3.
    torch.testing.assert_close(walks.points * 3.0, (walks.points * 3.0).round())
    assert walks.points.min() == 0.0
    assert walks.points.max() == pytest.approx(1.0)
    steps = walks.points.diff(dim=1)
    assert ((steps.abs() > 0.1).sum(dim=2) == 1).all()
    torch.testing.assert_close(steps.sum(dim=1), (walks.direction * 2 / 3).float())
    assert (walks.direction > 0).double().mean().item() == pytest.approx(0.5, abs=0.15)
    assert sorted(walks.order[0].tolist()) == [0, 1, 2, 3, 4]


def test_the_effects_of_a_linear_function_are_its_coefficients() -> None:
    coefficients = torch.tensor([3.0, 0.0, -2.0, 0.5, 1.0], dtype=torch.float64)
    walks = morris_trajectories(5, 7, 6, torch.Generator().manual_seed(1))
    values = walks.points.double() @ coefficients
    torch.testing.assert_close(
        mean_absolute_effects(walks, values, 6), coefficients.abs(), atol=1e-5, rtol=0.0
    )


def test_an_effect_that_changes_its_sign_is_seen() -> None:
    # x1 (x2 - 1/2): between levels 0 and 2/3 or 1/3 and 1, the effect of x1 is x2 - 1/2, whose
    # mean is 0; its absolute values on the grid are 1/2 and 1/6.
    walks = morris_trajectories(2, 4000, 4, torch.Generator().manual_seed(2))
    values = walks.points[..., 0] * (walks.points[..., 1] - 0.5)
    effects = mean_absolute_effects(walks, values.double(), 4)
    assert effects[0].item() == pytest.approx(1 / 3, abs=0.02)


def test_only_weights_that_move_j_are_searched() -> None:
    recorder = Recorder(two_matter)
    found = make().search(recorder)
    searched = torch.cat(recorder.packs[10:])
    assert (searched[:, [0, 2, 3, 5]] == 1.0).all()
    assert (found.pack[:, [0, 2, 3, 5]] == 1.0).all()
    torch.testing.assert_close(found.position[[1, 4]], torch.tensor([0.3, 0.7]), atol=0.02, rtol=0)
    assert two_matter(found.position[None]).item() == found.value
    # 70 evaluations for the screening, and 47 moves of 30 wolves: 30 * 48 = 1440 of 1460 left.
    assert found.evaluations == recorder.calls == SCREENING + 1440


def test_the_rest_stays_at_its_value_in_the_box_of_the_search() -> None:
    found = make("pso", inner={"lower": 0.2, "upper": 0.8}, rest=0.5).search(two_matter)
    assert (found.position[[0, 2, 3, 5]] == 0.5).all()
    torch.testing.assert_close(found.position[[1, 4]], torch.tensor([0.3, 0.7]), atol=0.02, rtol=0)


def test_a_weight_of_little_effect_is_searched_on_demand() -> None:
    def function(x: Tensor) -> Tensor:
        return two_matter(x) + 0.01 * x[:, 0]

    assert make().search(function).position[0] == 1.0
    assert make(min_share=0.0).search(function).position[0] < 0.5


def test_where_nothing_moves_j_nothing_is_searched() -> None:
    recorder = Recorder(constant)
    found = make(rest=0.25).search(recorder)
    assert found.position.tolist() == [0.25] * NUM_TERMS
    assert found.evaluations == SCREENING
    assert recorder.calls == SCREENING + 1  # the value at the rest is recorded, not chosen by


def test_a_warm_start_reaches_the_weights_that_are_searched() -> None:
    optimizer = make(inner={"warm_start": True})
    optimizer.last_weights = torch.tensor([0.0, 0.31, 0.0, 0.0, 0.69, 0.0])
    recorder = Recorder(two_matter)
    optimizer.search(recorder)
    first = recorder.packs[10][0]
    torch.testing.assert_close(first, torch.tensor([1.0, 0.31, 1.0, 1.0, 0.69, 1.0]))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"choice": "random"}, r"inner makes a UniformWeights, which does not search"),
        (
            {"inner": {"persistent": True}},
            r"inner keeps its pack between iterations.*persistent=false",
        ),
        ({"budget": 70}, "budget, of which the screening takes 70, is 70; allowed: at least 71"),
        ({"budget": 100}, r"budget of 30 evaluations is less than a pack of 30"),
        ({"levels": 3}, r"levels must be even, got 3"),
        ({"rest": 2.0}, r"rest is 2\.0; allowed: from 0 to 1"),
        ({"min_share": -1.0}, r"min_share is -1\.0; allowed: from 0 to 1"),
        ({"walks": 0}, "walks is 0; allowed: at least 1"),
    ],
)
def test_bad_settings_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make(**settings)
