"""Small learners, the batches they learn from, and trainings."""

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.envs import ExplorationType, set_exploration_type

from tlr_exp import keys
from tlr_exp.config.settings import PpoSettings, Settings
from tlr_exp.ppo.learner import Ppo
from tlr_exp.ppo.networks import build_actor, build_critic
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.training.loop import Training
from tlr_exp.training.run import check_inputs

OBSERVATION_DIM, PRIVILEGED_DIM, ACTION_DIM = 4, 2, 3
ONE_PASS = ("ppo.num_epochs=1", "ppo.num_minibatches=1")


def build_learner(
    settings: PpoSettings, seed: int = 0, critic: TensorDictModule | None = None
) -> Ppo:
    """Equal learners for equal arguments, whatever the global generator."""
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        noise = torch.Generator().manual_seed(seed + 1)
        actor = build_actor(OBSERVATION_DIM, ACTION_DIM, settings, noise)
        critic = critic or build_critic(OBSERVATION_DIM, PRIVILEGED_DIM, settings)
    return Ppo(actor, critic, settings, seed=seed + 2, exploration=noise)


def build_training(settings: Settings, run: RunDirectory) -> Training:
    """A training as a command makes it, which checks the configuration first."""
    return Training(settings, run, check_inputs(settings))


def first_observation_as_value() -> TensorDictModule:
    """A critic whose value of a state is the first number of its observation."""
    layer = nn.Linear(OBSERVATION_DIM, 1, bias=False)
    with torch.no_grad():
        layer.weight.copy_(torch.tensor([[1.0, 0.0, 0.0, 0.0]]))
    return TensorDictModule(layer, in_keys=[keys.OBSERVATION], out_keys=["state_value"])


def collected(ppo: Ppo, num_envs: int = 32, num_steps: int = 4, seed: int = 0) -> TensorDictBase:
    """A batch on random observations, acted on by the policy; rewards are random, too."""
    generator = torch.Generator().manual_seed(seed)

    def draw(*shape: int) -> Tensor:
        return torch.randn(num_envs, num_steps, *shape, generator=generator)

    now, after = (
        {keys.OBSERVATION: draw(OBSERVATION_DIM), keys.PRIVILEGED: draw(PRIVILEGED_DIM)}
        for _ in range(2)
    )
    terminated = draw(1) > 1.0
    truncated = (draw(1) > 1.0) & ~terminated
    flags = {keys.TERMINATED: terminated, keys.TRUNCATED: truncated}
    after |= {keys.REWARD: draw(1), **flags, keys.DONE: terminated | truncated}
    batch = TensorDict({**now, "next": after}, [num_envs, num_steps])
    with torch.no_grad(), set_exploration_type(ExplorationType.RANDOM):
        return ppo.actor(batch)


def ready(ppo: Ppo, **sizes: int) -> TensorDictBase:
    batch = collected(ppo, **sizes)
    ppo.estimate_advantages(batch)
    return batch


def parameters_of(ppo: Ppo) -> list[Tensor]:
    return [p.detach().clone() for p in (*ppo.actor_parameters, *ppo.critic_parameters)]


def same(left: list[Tensor], right: list[Tensor]) -> bool:
    return all(torch.equal(a, b) for a, b in zip(left, right, strict=True))
