"""The control with random weights."""

import torch
from configured import make


def test_weights_are_uniform_on_the_box_whatever_the_returns() -> None:
    optimizer = make("random", num_terms=4, lower=0.5, upper=2.5)
    goal_return = torch.arange(10.0)
    term_returns = -torch.arange(40.0).reshape(10, 4)
    updates = [optimizer.update(goal_return, term_returns) for _ in range(500)]
    weights = torch.stack([update.weights for update in updates])
    # Mean 1.5, standard deviation 2 / sqrt(12); five standard errors of 500 draws.
    standard_error = 2.0 / 12**0.5 / 500**0.5
    assert ((weights.mean(dim=0) - 1.5).abs() < 5 * standard_error).all()
    assert weights.min() < 0.51
    assert weights.max() > 2.49
    assert {update.evaluations for update in updates} == {0}
    # The terms are not correlated: a draw for each, not one for all.
    off_diagonal = torch.corrcoef(weights.T)[~torch.eye(4, dtype=torch.bool)]
    assert (off_diagonal.abs() < 5 / 500**0.5).all()
