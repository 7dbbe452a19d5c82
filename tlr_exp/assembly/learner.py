"""Actor, critic and learner, from settings."""

import torch

from tlr_exp.assembly.robot import spec_of
from tlr_exp.assembly.seeds import Seeds
from tlr_exp.config.load import ConfigError
from tlr_exp.config.settings import Settings
from tlr_exp.env.observations import observation_dims, privileged_dim
from tlr_exp.machine.precision import chosen_precision
from tlr_exp.ppo.learner import Ppo
from tlr_exp.ppo.networks import build_actor, build_critic, set_precision


def build_ppo(settings: Settings) -> Ppo:
    """Actor, critic and learner on the run's device."""
    seeds, device = Seeds.of(settings.seed), check_device(settings.device)
    spec = spec_of(settings.env)
    observation_dim = observation_dims(spec)[settings.env.observation]
    exploration = torch.Generator(device=device).manual_seed(seeds.exploration)
    # The layers draw their first weights from the global generator: give them one of their own.
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seeds.networks)
        actor = build_actor(observation_dim, spec.num_joints, settings.ppo, exploration)
        critic = build_critic(observation_dim, privileged_dim(spec), settings.ppo)
    precision = chosen_precision(settings.precision, settings.device)
    for network in (actor, critic):
        network.to(device)
        set_precision(network, precision)
    return Ppo(actor, critic, settings.ppo, seeds.minibatches, exploration)


def check_device(name: str) -> torch.device:
    """The device of that name.

    Raises:
        ConfigError: it is not there.
    """
    if name != "cpu" and not torch.cuda.is_available():
        raise ConfigError(
            f"device is {name!r}, but PyTorch finds no CUDA device here; allowed: cpu"
        )
    device = torch.device(name)
    if (device.index or 0) >= max(1, torch.cuda.device_count()):
        raise ConfigError(
            f"device is {name!r}; allowed: cpu, cuda:0 to cuda:{torch.cuda.device_count() - 1}"
        )
    return device
