"""The gradient of the policy for every reward apart, for those who choose weights by it.

The critic foretells the composed reward, at the weights of earlier iterations: it cannot say what
a single term is worth in a state. But what its last layer sees tells states apart, so that a linear
function of that serves as a critic for every reward: one small system of equations, solved anew on
every batch. Values and advantages made so are linear in the rewards: those of the reward at weights
w are goal + sum over terms of w_i times those of term i.
"""

from functools import cached_property

import torch
from tensordict import TensorDictBase
from tensordict.nn import ProbabilisticTensorDictSequential
from torch import Tensor
from torch.func import functional_call
from torchrl.objectives.value.functional import generalized_advantage_estimate

from tlr_exp import keys
from tlr_exp.errors import UserError

# States that the actor sees at a time, as for the critic: activations take memory.
ROWS = 12288
RIDGE = 1e-5  # small against 1 - gamma, by which features that change slowly count


def linear_values(
    features: Tensor, features_after: Tensor, rewards: Tensor, terminated: Tensor, gamma: float
) -> tuple[Tensor, Tensor]:
    """The values of every reward in the states of a batch, and in those that the steps lead to.

    By least-squares temporal differences (Bradtke and Barto 1996): with features f, and f' after
    the step, V_k = theta_k . f where

        mean(f (f - gamma f')^T) theta_k = mean(f r_k),

    f' being 0 where an episode has failed. `RIDGE` of the mean square of a feature is added to the
    diagonal, for features that are 0 or do not differ.

    Args:
        features, features_after: [num_envs, num_steps, num_features].
        rewards: [num_envs, num_steps, num_rewards].
        terminated: whether a step ended an episode by failure [num_envs, num_steps, 1] bool.
        gamma: discount of a control step.
    """
    now = features.flatten(0, 1).double()
    after = (features_after * ~terminated).flatten(0, 1).double()
    matrix = now.T @ (now - gamma * after) / len(now)
    matrix.diagonal().add_(RIDGE * now.square().mean())
    weights = torch.linalg.solve(matrix, now.T @ rewards.flatten(0, 1).double() / len(now))
    weights = weights.to(features)
    return features @ weights, features_after @ weights


def advantages_apart(
    rewards: Tensor,
    values: tuple[Tensor, Tensor],
    done: Tensor,
    terminated: Tensor,
    gamma: float,
    gae_lambda: float,
) -> Tensor:
    """Generalised advantages of every reward [num_envs, num_steps, num_rewards], less their mean.

    All are divided by one number, so that those of the first reward have the standard deviation 1.

    Args:
        rewards: [num_envs, num_steps, num_rewards].
        values: those of every reward before and after a step, each of the shape of `rewards`.
        done, terminated: whether a step ended an episode, and whether by failure
            [num_envs, num_steps, 1] bool.
        gamma, gae_lambda: those of the learner.
    """
    advantages, _ = generalized_advantage_estimate(
        *(gamma, gae_lambda, *values, rewards),
        done=done.expand_as(rewards),
        terminated=terminated.expand_as(rewards),
    )
    advantages = advantages - advantages.mean(dim=(0, 1))
    return advantages / (advantages[..., 0].std() + 1e-8)


class BatchGradients:
    """Policy gradients on a batch for each of several rewards, of which the first is the goal's.

    They are those of mean(pi_theta(a | s) / pi(a | s) * A_k(s, a)) by the actor's parameters, in
    one row. The actor and its gradients are left as they are, and nothing is computed before it is
    asked for.

    Args:
        actor: the policy pi that has collected the batch.
        samples: its observations, actions and their log-probabilities [num_envs, num_steps].
        advantages: A_k [num_envs, num_steps, num_rewards].
    """

    def __init__(
        self,
        actor: ProbabilisticTensorDictSequential,
        samples: TensorDictBase,
        advantages: Tensor,
    ) -> None:
        self.actor, self.samples, self.advantages = actor, samples, advantages

    @property
    def goal(self) -> Tensor:
        """Gradient for the goal's reward [num_parameters]."""
        return self._present[0]

    @property
    def terms(self) -> Tensor:
        """Gradient for every other reward [num_terms, num_parameters]."""
        return self._present[1:]

    def goal_after(self, step: Tensor) -> Tensor:
        """Gradient for the goal's reward [num_parameters], at the parameters plus ``step``."""
        return self._gradients(self.advantages[..., :1], step)[0]

    def halves(self) -> tuple["BatchGradients", "BatchGradients"]:
        """The same of every other environment, and of the others. Their mean is the whole batch's.

        Raises:
            UserError: there is only one environment.
        """
        if len(self.samples) < 2:
            raise UserError("one environment has no halves: use scale.num_envs=2 or more")
        first, second = (
            BatchGradients(self.actor, self.samples[place::2], self.advantages[place::2])
            for place in (0, 1)
        )
        return first, second

    @cached_property
    def _present(self) -> Tensor:
        """Gradients for all rewards at the present policy [num_rewards, num_parameters]."""
        return self._gradients(self.advantages, None)

    def _gradients(self, advantages: Tensor, step: Tensor | None) -> Tensor:
        """Gradients for these advantages [num_rewards, num_parameters], after a step."""
        parameters = self._parameters_after(step)
        samples, advantages = self.samples.reshape(-1), advantages.flatten(0, 1)
        total = torch.zeros((), device=advantages.device)
        for part, part_advantages in zip(samples.split(ROWS), advantages.split(ROWS), strict=True):
            with torch.enable_grad():
                ratio = (self._log_prob(part, parameters) - part["action_log_prob"]).exp()
            rows = [
                torch.autograd.grad(ratio, list(parameters.values()), each, retain_graph=True)
                for each in part_advantages.T
            ]
            total = total + torch.stack([_in_one_row(row) for row in rows])
        return total / len(samples)

    def _parameters_after(self, step: Tensor | None) -> dict[str, Tensor]:
        """Copies of the actor's parameters by name, moved by ``step`` [num_parameters]."""
        present = {name: p.detach().clone() for name, p in self.actor[0].named_parameters()}
        if step is not None:
            parts = step.split([p.numel() for p in present.values()])
            present = {
                name: p + part.view_as(p)
                for (name, p), part in zip(present.items(), parts, strict=True)
            }
        return {name: p.requires_grad_() for name, p in present.items()}

    def _log_prob(self, samples: TensorDictBase, parameters: dict[str, Tensor]) -> Tensor:
        """Log-probability of the actions of ``samples`` [n], if the policy had ``parameters``."""
        seen = samples.select(keys.OBSERVATION)
        # The first module gives the parameters of the distribution; nothing is drawn from it.
        given = functional_call(self.actor[0], parameters, (seen,))
        return self.actor.build_dist_from_params(given).log_prob(samples[keys.ACTION])


def _in_one_row(tensors: tuple[Tensor, ...]) -> Tensor:
    return torch.cat([tensor.flatten() for tensor in tensors])
