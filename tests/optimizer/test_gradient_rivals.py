"""Rivals that weigh terms by policy gradients: steps by hand, and problems with known answers."""

import math

import pytest
import torch
from configured import make
from policies import Stated, asked, random_gradients

from tlr_exp.errors import UserError

RIVALS = ["gradnorm", "pcgrad", "meta_gradient"]


def stated(goal: list[float], *terms: list[float]) -> Stated:
    return Stated(torch.tensor(goal), torch.tensor(terms))


# --- gradnorm --------------------------------------------------------------------------------

# The goal's gradient has length 5; 10, 1 and 0 those of the terms.
UNEQUAL = stated([3.0, 4.0], [0.0, -10.0], [1.0, 0.0], [0.0, 0.0])


def test_a_balance_at_once_by_hand():
    # Targets 0.5 * 5 / 10 = 0.25, 0.5 * 5 / 1 = 2.5 (the largest weight is 1), 1 without gradient.
    update = asked(make("gradnorm", num_terms=3, ratio=0.5, rate=1.0), UNEQUAL)
    assert update.weights.tolist() == [0.25, 1.0, 1.0]
    ratios = [update.details[f"gradient_ratio/cost{num}"] for num in range(3)]
    assert ratios == pytest.approx([2.0, 0.2, 0.0])
    # -40 / (5 * 10) and 3 / (5 * 1).
    assert update.details["gradient_cosine/cost0"] == pytest.approx(-0.8)
    assert update.details["gradient_cosine/cost1"] == pytest.approx(0.6)
    assert math.isnan(update.details["gradient_cosine/cost2"])


def test_a_balance_step_by_step_reaches_the_ratio():
    balance = make("gradnorm", num_terms=3, ratio=0.5, rate=0.1)
    first = asked(balance, UNEQUAL).weights
    assert first.tolist() == pytest.approx([1.0 + 0.1 * (0.25 - 1.0), 1.0, 1.0])
    for _ in range(200):
        weights = asked(balance, UNEQUAL).weights
    assert weights[0] * UNEQUAL.terms[0].norm() == pytest.approx(0.5 * 5.0)


def test_a_goal_without_a_gradient_leaves_no_force_to_the_terms():
    gradients = stated([0.0, 0.0], [0.0, -10.0])
    assert asked(make("gradnorm", num_terms=1, rate=1.0), gradients).weights.tolist() == [0.0]


# --- pcgrad ----------------------------------------------------------------------------------


def test_a_projection_in_the_plane_by_hand():
    # (-1, 1) opposes (2, 0) and loses what does: (0, 1) is left. (1, 1) agrees and stays.
    # The sum (2, 0) + (0, 1) + (1, 1) = (3, 2) is that at the weights 2/3, times 1.5.
    gradients = stated([2.0, 0.0], [-1.0, 1.0], [1.0, 1.0])
    weights = asked(make("pcgrad", num_terms=2), gradients).weights
    assert weights.tolist() == pytest.approx([2 / 3, 2 / 3])
    combined = gradients.goal + weights @ gradients.terms
    assert (1.5 * combined).tolist() == pytest.approx([3.0, 2.0])


def test_without_opposition_a_projection_changes_nothing():
    gradients = stated([2.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.0, 0.0])
    assert asked(make("pcgrad", num_terms=3), gradients).weights.tolist() == [1.0] * 3


@pytest.mark.parametrize("seed", range(5))
def test_a_projected_sum_never_opposes_the_goal(seed):
    gradients = random_gradients(seed, num_terms=6)
    goal, terms = gradients.goal, gradients.terms
    along = (terms @ goal / goal.square().sum()).clamp(max=0.0)
    projected = terms - along[:, None] * goal
    assert ((projected @ goal) > -1e-5).all()
    weights = asked(make("pcgrad", num_terms=6), gradients).weights
    combined, surgery = goal + weights @ terms, goal + projected.sum(dim=0)
    torch.testing.assert_close(combined / combined.norm(), surgery / surgery.norm())
    assert ((weights > 0.0) & (weights <= 1.0)).all()


# --- meta-gradient ---------------------------------------------------------------------------


class Quadratic:
    """An objective J(theta) = g . theta - theta' H theta / 2 of the goal, terms that are linear."""

    def __init__(self, seed: int) -> None:
        generator = torch.Generator().manual_seed(seed)
        draw = torch.randn(7, 3, generator=generator, dtype=torch.float64)
        self.goal, self.terms = draw[0], draw[1:3]
        self.hessian = draw[3:6] @ draw[3:6].T

    def value(self, theta):
        return self.goal @ theta - 0.5 * theta @ self.hessian @ theta

    def goal_after(self, step):
        return self.goal - self.hessian @ step


def test_the_meta_gradient_is_that_of_finite_differences():
    learning, judging = Quadratic(0), Quadratic(1)
    meta = make("meta_gradient", num_terms=2, step_size=0.7, max_grad_norm=100.0)
    meta.last_weights = torch.tensor([0.25, 0.5])

    def gained(weights):
        return judging.value(0.7 * (learning.goal + weights.double() @ learning.terms))

    expected = []
    for num in range(2):
        small = torch.zeros(2, dtype=torch.float64)
        small[num] = 1e-4
        difference = gained(meta.last_weights + small) - gained(meta.last_weights - small)
        expected.append((difference / 2e-4).item())
    assert meta.derivative(learning, judging).tolist() == pytest.approx(expected, rel=1e-6)


def test_the_meta_gradient_and_its_error_come_from_both_halves():
    # Without curvature the goal's gradient is the same after the step. Learning on the first
    # half: 0.5 * (1, 0) . (0, 2) = 0; on the second: 0.5 * (4, 1) . (1, 1) = 2.5.
    first, second = stated([1.0, 1.0], [1.0, 0.0]), stated([0.0, 2.0], [4.0, 1.0])
    gradients = Stated(torch.ones(2), torch.ones(1, 2), parts=(first, second))
    meta = make("meta_gradient", num_terms=1, step_size=0.5, max_grad_norm=9.0, rate=0.1)
    update = asked(meta, gradients)
    assert update.details == {
        "meta_gradient/cost0": 1.25,
        "meta_gradient_error/cost0": 1.25,
        "meta_gradient_noise": 1.0,
    }
    assert update.weights.tolist() == [1.0]  # it would rise by 0.1, out of the box


def test_a_step_by_a_steep_gradient_is_shortened():
    # g + w g_1 = (6, 8), of length 10: a step of 0.5 * (0.6, 0.8) instead of 0.5 * (6, 8). With
    # curvature the goal's gradient there is (3, 4) - 10 * (0.3, 0.4) = (0, 0), without it (3, 4).
    steep = stated([3.0, 4.0], [3.0, 4.0])
    meta = make("meta_gradient", num_terms=1, step_size=0.5, max_grad_norm=1.0)
    curved = Stated(steep.goal, steep.terms, curvature=10.0)
    assert meta.derivative(steep, curved).tolist() == pytest.approx([0.0], abs=1e-5)
    # 0.5 / 10 * (3, 4) . (3, 4)
    assert meta.derivative(steep, steep).tolist() == pytest.approx([1.25])


def test_what_is_no_number_leaves_nothing_behind():
    meta = make("meta_gradient", num_terms=2, rate=0.1)
    good = stated([1.0, 0.0], [-3.0, 0.0], [0.0, 1.0])
    broken = Stated(good.goal * torch.nan, good.terms)
    assert asked(meta, broken).weights.tolist() == [1.0, 1.0]
    assert asked(meta, good).weights[0] < 1.0


def test_a_first_step_is_as_long_as_the_rate_and_downwards_for_a_term_that_harms():
    gradients = stated([1.0, 0.0], [-3.0, 0.0], [0.01, 0.0], [0.0, 1.0])
    update = asked(make("meta_gradient", num_terms=3, rate=0.1, upper=2.0), gradients)
    # The third does nothing for the goal, and keeps its weight.
    assert update.weights.tolist() == pytest.approx([0.9, 1.1, 1.0])


# --- what all of them must do ----------------------------------------------------------------


def trained(rival: str, iterations: int = 400) -> tuple[float, torch.Tensor]:
    """The goal's objective and the weights after a training of a policy (x, y) at first (0, 0).

    The goal is -(x - 1)^2 / 2. One cost pulls x back to 0, the other y to 1, which is nothing to
    the goal. Under the static reward x ends at 1/4: x - 1 + 3 x = 0.
    """
    optimizer = make(rival, num_terms=2)
    policy = torch.zeros(2)
    for _ in range(iterations):
        x, y = policy
        gradients = Stated(
            goal=torch.stack((1.0 - x, torch.zeros(()))),
            terms=torch.stack((torch.stack((-3.0 * x, 0 * x)), torch.stack((0 * y, 1.0 - y)))),
            curvature=torch.tensor([1.0, 0.0]),
        )
        weights = asked(optimizer, gradients).weights
        policy = policy + 0.1 * (gradients.goal + weights @ gradients.terms)
    return -0.5 * (policy[0].item() - 1.0) ** 2, weights


@pytest.mark.parametrize("rival", RIVALS)
def test_where_one_cost_harms_the_goal_a_rival_beats_the_static_reward(rival):
    static, _ = trained("fixed")
    assert static == pytest.approx(-0.5 * 0.75**2)
    achieved, weights = trained(rival)
    assert achieved > static / 50
    assert weights[0] < 0.15  # of the cost that harms


def test_a_cost_that_is_nothing_to_the_goal_keeps_its_weight():
    assert trained("meta_gradient")[1].tolist() == pytest.approx([0.0, 1.0], abs=0.01)


@pytest.mark.parametrize("rival", RIVALS)
def test_a_training_that_tells_of_no_policy_is_refused(rival):
    with pytest.raises(UserError, match="by their policy gradients, and was told of none"):
        make(rival, num_terms=2).update(torch.arange(20.0), -torch.ones(20, 2))


@pytest.mark.parametrize("rival", RIVALS)
def test_gradients_are_asked_for_once_and_not_kept(rival):
    optimizer = make(rival, num_terms=2)
    asked(optimizer, random_gradients(0, 2))
    with pytest.raises(UserError, match="told of none"):
        optimizer.update(torch.arange(20.0), -torch.ones(20, 2))


@pytest.mark.parametrize("rival", RIVALS)
def test_a_closed_gate_asks_for_no_gradients(rival):
    class Costly:
        terms = torch.ones(2, 2)

    gate = make("when_tracking", f"optimizer@optimizer.inner={rival}", num_terms=2)
    update = asked(gate, Costly())  # told of no goal reward, so it stays closed
    assert update.weights.tolist() == [1.0, 1.0]


@pytest.mark.parametrize("rival", RIVALS)
def test_a_rival_is_no_search_for_effective_dimensions(rival):
    with pytest.raises(ValueError, match="which does not search"):
        make("effective_dimension", f"optimizer@optimizer.inner={rival}")


@pytest.mark.parametrize(
    ("rival", "settings", "message"),
    [
        ("gradnorm", {"ratio": 0.0}, r"ratio is 0\.0; allowed: above 0"),
        ("gradnorm", {"rate": 1.5}, r"rate is 1\.5; allowed: from 0 to 1"),
        ("meta_gradient", {"step_size": -1.0}, r"step_size is -1\.0; allowed: above 0"),
        ("meta_gradient", {"max_grad_norm": 0.0}, r"max_grad_norm is 0\.0; allowed: above 0"),
        ("meta_gradient", {"rate": 0.0}, r"rate is 0\.0; allowed: above 0"),
        ("meta_gradient", {"square_decay": 1.0}, r"square_decay is 1\.0; .* below 1"),
    ],
)
def test_bad_settings_are_refused_by_name(rival, settings, message):
    with pytest.raises(ValueError, match=message):
        make(rival, **settings)
