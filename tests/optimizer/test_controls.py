"""The controls that a claim for a search must beat: no lower layer, chance, ASAP's curriculum."""

from pathlib import Path
from typing import Any

import pytest
import torch
from configured import make
from landscapes import Recorder, uneven_bowl

from tlr_exp.config.components import instantiate
from tlr_exp.optimizer.protocol import TrainingProgress
from tlr_exp.optimizer.random_search import random_search
from tlr_exp.optimizer.search import SearchTask
from tlr_exp.reward.objectives import RankDeviation

OBJECTIVE = RankDeviation(0.34)
GOAL_RETURN = torch.tensor([3.0, 2.0, 1.0])
TERM_RETURNS = torch.tensor([[-1.0, -1.5], [0.0, 0.0], [0.0, 0.0]])


def test_without_a_lower_layer_no_rank_changes() -> None:
    # At the weights 1 the candidate falls to rank 3: ((1 - 3) / 100)^2.
    update = make("zero", num_terms=2, objective=OBJECTIVE).update(GOAL_RETURN, TERM_RETURNS)
    assert update.weights.tolist() == [0.0, 0.0]
    assert update.objective == 0.0
    assert update.baseline_objective == 0.0004
    assert update.evaluations == 0


def test_random_search_is_the_best_of_its_uniform_draws() -> None:
    recorder = Recorder(uneven_bowl)
    lower, upper = torch.tensor([0.0, 0.5]), torch.tensor([1.0, 1.0])
    generator = torch.Generator().manual_seed(0)
    found = random_search(
        recorder, SearchTask(lower=lower, upper=upper, generator=generator), budget=2000
    )
    draws = torch.cat(recorder.packs)
    assert len(draws) == 2000
    assert torch.equal(found.position, draws[torch.cat(recorder.values).argmin()])
    # Mean (0.5, 0.75), standard deviation width / sqrt(12); five standard errors.
    error = 5.0 * (upper - lower) / 12**0.5 / 2000**0.5
    assert ((draws.mean(dim=0) - torch.tensor([0.5, 0.75])).abs() < error).all()
    assert found.optimal_share == 1 / 2000


def scale_after(*lengths: float, num_steps: int = 24, **settings: Any) -> float:
    curriculum = make("curriculum", num_terms=2, objective=OBJECTIVE, **settings)
    for length in lengths:
        curriculum.observe(TrainingProgress(length, num_steps))
    update = curriculum.update(GOAL_RETURN, TERM_RETURNS)
    assert update.weights[0] == update.weights[1]
    return update.weights[0].item()


def test_the_scale_follows_the_length_of_the_episodes() -> None:
    assert scale_after() == pytest.approx(0.1)
    # In each of 24 control steps by 1e-5: 0.1 * 1.00001^24 = 0.1 + 2.4003e-5.
    assert scale_after(42.5) == pytest.approx(0.1 + 2.4003e-5, abs=1e-8)
    assert scale_after(39.5) == pytest.approx(0.1 - 2.3997e-5, abs=1e-8)
    assert scale_after(40.0, 41.0, 42.0) == pytest.approx(0.1)
    assert scale_after(100.0, 100.0, num_steps=2, rate=0.5) == pytest.approx(0.1 * 1.5**4)
    assert scale_after(10.0, num_steps=2, rate=0.5) == pytest.approx(0.1 * 0.5**2)


def test_the_scale_stops_at_its_largest_value_and_comes_back_from_it() -> None:
    settings = {"rate": 0.1, "num_steps": 100}
    assert scale_after(50.0, **settings) == 1.0
    assert scale_after(50.0, 10.0, **settings) == pytest.approx(0.9**100)
    assert scale_after(50.0, largest=0.3, **settings) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("scale", "largest_end", "rate_to_one"),
    [("demo", 0.1006, None), ("laptop", 0.1103, 2.4e-4), ("paper", 0.1822, 4e-5)],
)
def test_where_the_curriculum_ends_is_what_its_file_and_its_page_say(
    settings_of, scale, largest_end, rate_to_one
) -> None:
    settings = settings_of(f"scale={scale}", "optimizer=curriculum")

    def end(**changes: Any) -> float:
        curriculum = instantiate(
            "optimizer",
            {**settings.optimizer, **changes},
            num_terms=2,
            objective=RankDeviation(0.1),
            seed=0,
            device="cpu",
        )
        for _ in range(settings.scale.iterations):
            curriculum.observe(TrainingProgress(200.0, settings.ppo.num_steps))
        return curriculum.scale.item()

    assert end() == pytest.approx(largest_end, abs=5e-5)
    root = Path(__file__).parents[2]
    for page in ("conf/optimizer/curriculum.yaml", "docs/rivals.md"):
        text = (root / page).read_text(encoding="utf-8")
        assert str(largest_end) in text
        assert "230 260 control steps" in text  # ln(10) / ln(1 + 1e-5) = 230 259.7
    if rate_to_one is not None:
        assert end(rate=rate_to_one) == 1.0


def test_a_curriculum_does_without_terms() -> None:
    curriculum = make("curriculum", num_terms=0, objective=OBJECTIVE)
    update = curriculum.update(GOAL_RETURN, torch.zeros(3, 0))
    assert update.weights.shape == (0,)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"initial": 2.0}, r"initial is 2\.0; allowed: from 0 to 1"),
        ({"rate": -0.1}, r"rate is -0\.1; allowed: from 0 to 1"),
        ({"largest": -1.0}, r"largest is -1\.0; allowed: above 0"),
        ({"shrink_below_steps": 50.0}, r"shrink_below_steps 50\.0 exceeds grow_above_steps 42\.0"),
    ],
)
def test_bad_settings_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make("curriculum", **settings)
