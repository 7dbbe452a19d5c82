"""Proximal policy optimisation: advantages and the update of actor and critic.

What it learns from is a batch [num_envs, num_steps] whose ``("next", "reward")`` has been
composed; how, it does not know.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import torch
from tensordict import TensorDictBase
from tensordict.nn import ProbabilisticTensorDictSequential, TensorDictModule
from torch import Tensor
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value.functional import generalized_advantage_estimate

from tlr_exp import keys
from tlr_exp.config.settings import PpoSettings
from tlr_exp.errors import UserError
from tlr_exp.ppo.networks import GaussianHead, in_float32, noted_features, update_norms
from tlr_exp.ppo.policy_gradients import BatchGradients, advantages_apart, linear_values

# States that the critic values at a time: for 4096 x 24 at once its activations take a gigabyte.
VALUE_ROWS = 12288


@dataclass(frozen=True)
class PpoDiagnostics:
    """Means over all minibatches of one update; the last two are of the whole batch before it.

    ``explained_variance`` is 1 - Var(target - value) / Var(target) of the critic that collected:
    1 where it foresees every return, 0 where it tells no more than their mean.
    """

    surrogate_loss: float
    value_loss: float
    entropy: float
    kl: float
    clip_fraction: float
    learning_rate: float
    action_std: float
    explained_variance: float


class NonFiniteLossError(UserError):
    """The loss or its gradient stopped being finite; that minibatch left the policy as it was."""


class Ppo:
    """The learner: GAE, the clipped surrogate, and a learning rate that follows the KL divergence.

    Args:
        actor: writes ``loc``, ``scale`` and the action's log-probability.
        critic: writes ``state_value``.
        settings: see ``conf/ppo``.
        seed: of the generator that shuffles the minibatches.
        exploration: the generator that the actor draws its noise from; saved with the learner.
    """

    def __init__(
        self,
        actor: ProbabilisticTensorDictSequential,
        critic: TensorDictModule,
        settings: PpoSettings,
        seed: int,
        exploration: torch.Generator,
    ) -> None:
        self.actor, self.critic, self.settings = actor, critic, settings
        self.exploration = exploration
        self.loss = ClipPPOLoss(
            actor,
            critic,
            clip_epsilon=settings.clip_epsilon,
            entropy_coeff=settings.entropy_coeff,
            critic_coeff=settings.critic_coeff,
            clip_value=settings.value_clip,
            loss_critic_type="l2",
            normalize_advantage=False,
        )
        self.actor_head = next(m for m in actor.modules() if isinstance(m, GaussianHead))
        self.actor_parameters = list(actor.parameters())
        self.critic_parameters = list(critic.parameters())
        self.adam = torch.optim.Adam(
            [*self.actor_parameters, *self.critic_parameters],
            lr=settings.learning_rate,
            fused=True,
        )
        self.generator = torch.Generator().manual_seed(seed)

    @torch.no_grad()
    def estimate_advantages(self, batch: TensorDictBase) -> None:
        """Write ``advantage`` (normalised over the batch) and ``value_target`` into ``batch``.

        A terminated step is worth its reward alone, a truncated one also what the critic expects
        of the state that it ended in.
        """
        after: TensorDictBase = batch.get("next")
        batch["state_value"] = self._values(batch)
        advantage, batch["value_target"] = generalized_advantage_estimate(
            self.settings.gamma,
            self.settings.gae_lambda,
            batch["state_value"],
            self._after(batch["state_value"], after, self._values),
            after[keys.REWARD],
            done=after[keys.DONE],
            terminated=after[keys.TERMINATED],
        )
        batch["advantage"] = (advantage - advantage.mean()) / (advantage.std() + 1e-8)

    def _after(
        self, values: Tensor, after: TensorDictBase, ask: Callable[[TensorDictBase], Tensor]
    ) -> Tensor:
        """What the critic tells [num_envs, num_steps, n] of the states in which the steps ended.

        Within an episode that state is where the next step begins, of which it has told ``values``:
        only where an episode or the batch ends is the critic asked again.
        """
        cut = after[keys.DONE].squeeze(-1).clone()
        cut[:, -1] = True
        values_after = values.roll(-1, dims=1)
        values_after[cut] = ask(after.select(*self.critic.in_keys)[cut])
        return values_after

    def _values(self, states: TensorDictBase) -> Tensor:
        """The critic's values [..., 1] of ``states`` [...], in bounded memory."""
        rows = states.select(*self.critic.in_keys).reshape(-1)
        # In full precision, because an advantage is a small difference of large values.
        with in_float32(self.critic):
            values = [self.critic(part)["state_value"] for part in rows.split(VALUE_ROWS)]
        return torch.cat(values).reshape(*states.batch_size, 1)

    @torch.no_grad()
    def policy_gradients(self, batch: TensorDictBase, rewards: Tensor) -> BatchGradients:
        """Gradients of the policy that collected ``batch`` [num_envs, num_steps], by reward.

        ``rewards`` are [num_envs, num_steps, num_rewards], the goal's first.
        """
        gamma, gae_lambda = self.settings.gamma, self.settings.gae_lambda
        after: TensorDictBase = batch.get("next")
        done, terminated = after[keys.DONE], after[keys.TERMINATED]
        features = self._features(batch)
        features_after = self._after(features, after, self._features)
        values = linear_values(features, features_after, rewards, terminated, gamma)
        advantages = advantages_apart(rewards, values, done, terminated, gamma, gae_lambda)
        samples = batch.select(keys.OBSERVATION, keys.ACTION, "action_log_prob")
        return BatchGradients(self.actor, samples, advantages)

    def _features(self, states: TensorDictBase) -> Tensor:
        """What the critic's last layer sees of ``states`` [...], and a 1 [..., num_features]."""
        with noted_features(self.critic) as seen:
            self._values(states)
        features = torch.nn.functional.pad(torch.cat(seen), (0, 1), value=1.0)
        return features.reshape(*states.batch_size, -1)

    def update(self, batch: TensorDictBase, progress: float = 0.0) -> PpoDiagnostics:
        """Improve actor and critic on ``batch`` [num_envs, num_steps]; then renew the norms.

        ``progress`` is the share of the training that is behind it, from 0 to 1; a learning rate
        that falls over the training follows it.

        Raises:
            NonFiniteLossError: the loss or its gradient is not finite.
        """
        last = self.settings.final_learning_rate
        if last is not None:
            first, decay_from = self.settings.learning_rate, self.settings.decay_from
            self._set_learning_rate(decayed_rate(first, last, decay_from, progress))
        samples = batch.select(*self._needed_keys()).reshape(-1)
        sums = torch.zeros(6, device=samples.device)
        for epoch in range(self.settings.num_epochs):
            for minibatch in self._minibatches(samples):
                sums += self._update_once(minibatch, epoch)
        means = sums / (self.settings.num_epochs * self.settings.num_minibatches)
        observation, privileged = batch[keys.OBSERVATION], batch[keys.PRIVILEGED]
        update_norms(self.actor, observation)
        update_norms(self.critic, torch.cat((observation, privileged), dim=-1))
        return PpoDiagnostics(
            *means.tolist(),
            action_std=samples["scale"].mean().item(),
            explained_variance=explained_variance(samples["value_target"], samples["state_value"]),
        )

    @property
    def learning_rate(self) -> float:
        return self.adam.param_groups[0]["lr"]

    def _needed_keys(self) -> list[str]:
        return [
            *(keys.OBSERVATION, keys.PRIVILEGED, keys.ACTION),
            *("action_log_prob", "loc", "scale", "advantage", "value_target", "state_value"),
        ]

    def _minibatches(self, samples: TensorDictBase) -> Iterator[TensorDictBase]:
        order = torch.randperm(len(samples), generator=self.generator)
        # Unlike chunk, this makes as many parts as asked for, whatever the number of samples.
        for part in order.tensor_split(self.settings.num_minibatches):
            yield samples[part.to(samples.device)]

    def _update_once(self, minibatch: TensorDictBase, epoch: int) -> Tensor:
        with self._noted_distribution() as present:
            losses = self.loss(minibatch)
        kl = _kl_divergence(minibatch, *present)
        total = losses["loss_objective"] + losses["loss_critic"] + losses["loss_entropy"]
        self.adam.zero_grad(set_to_none=True)
        total.backward()
        norms = [
            torch.nn.utils.clip_grad_norm_(parameters, self.settings.max_grad_norm)
            for parameters in (self.actor_parameters, self.critic_parameters)
        ]
        # A finite loss can have a gradient that is not.
        if not torch.stack([total.detach(), *norms]).isfinite().all():
            raise NonFiniteLossError(
                f"the loss is {total.item()} and the gradient norms of actor and critic are "
                f"{', '.join(str(norm.item()) for norm in norms)} in epoch {epoch} of the update: "
                "try a smaller ppo.learning_rate or ppo.max_learning_rate"
            )
        self._adapt_learning_rate(kl)
        self.adam.step()
        logged = ("loss_objective", "loss_critic", "entropy")
        rate = torch.as_tensor(self.learning_rate, device=kl.device)
        return torch.stack(
            [*(losses[name].detach() for name in logged), kl, losses["clip_fraction"], rate]
        )

    @contextmanager
    def _noted_distribution(self) -> Iterator[list[Tensor]]:
        """A list that gets ``loc`` and ``scale`` of the actor's next forward pass.

        The loss computes them and keeps them to itself; asking the actor again would cost a
        fifth of an update.
        """
        present: list[Tensor] = []
        hook = self.actor_head.register_forward_hook(
            lambda _module, _inputs, outputs: present.extend(value.detach() for value in outputs)
        )
        try:
            yield present
        finally:
            hook.remove()

    def _adapt_learning_rate(self, kl: Tensor) -> None:
        """Divide the rate by 1.5 above twice the target KL, multiply it below half (ASAP)."""
        target = self.settings.target_kl
        if target is None:
            return
        rate = self.learning_rate
        if kl > 2.0 * target:
            rate = max(self.settings.min_learning_rate, rate / 1.5)
        elif 0.0 < kl < 0.5 * target:
            rate = min(self.settings.max_learning_rate, rate * 1.5)
        self._set_learning_rate(rate)

    def _set_learning_rate(self, rate: float) -> None:
        for group in self.adam.param_groups:
            group["lr"] = rate

    def state_dict(self) -> dict[str, object]:
        return {
            "actor": self.actor.state_dict(),
            "critic": self.critic.state_dict(),
            "adam": self.adam.state_dict(),
            "generator": self.generator.get_state(),
            "exploration": self.exploration.get_state(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.actor.load_state_dict(state["actor"])
        self.critic.load_state_dict(state["critic"])
        self.adam.load_state_dict(state["adam"])
        self.generator.set_state(state["generator"])
        self.exploration.set_state(state["exploration"])


def explained_variance(target: Tensor, value: Tensor) -> float:
    """Share of the variance of ``target`` that ``value`` explains; NaN where there is none."""
    variance = target.var()
    if not variance > 0.0:
        return float("nan")
    return (1.0 - (target - value).var() / variance).item()


@torch.no_grad()
def _kl_divergence(collected: TensorDictBase, loc: Tensor, scale: Tensor) -> Tensor:
    """Mean KL divergence of the collecting policy from the present one, in nats."""
    old = torch.distributions.Normal(collected["loc"], collected["scale"])
    present = torch.distributions.Normal(loc, scale)
    return torch.distributions.kl_divergence(old, present).sum(dim=-1).mean()


def decayed_rate(first: float, last: float, decay_from: float, progress: float) -> float:
    """The rate ``first`` until the share ``decay_from`` is done, then a straight line to ``last``.

    ``progress`` is the share of the training that is done, from 0 to 1.
    """
    share = max(0.0, (progress - decay_from) / (1.0 - decay_from))
    return first + (last - first) * share
