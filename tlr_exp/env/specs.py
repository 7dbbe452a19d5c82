"""The TorchRL specs of the environment: shapes and types of what goes in and comes out."""

from functools import partial

import torch
from torch import Tensor
from torchrl.data import Binary, Bounded, Composite, Unbounded

from tlr_exp import keys

# Entries of one number an environment that are zero at the start of an episode.
CLEARED_BY_RESET = {
    keys.UPPER_BODY_ERROR: torch.float32,
    keys.LOWER_BODY_ERROR: torch.float32,
    keys.JOINT_ERROR: torch.float32,
    keys.PHASE: torch.float32,
    keys.FELL: torch.bool,
    keys.UNSTABLE: torch.bool,
    keys.TERMINATED: torch.bool,
    keys.TRUNCATED: torch.bool,
    keys.DONE: torch.bool,
}
# What the environment keeps of the state that it has shown last.
SHOWN_OF_STATE = ("observed", "privileged", "state_costs")


def observation_spec(
    batch: torch.Size,
    device: torch.device,
    observation_dim: int,
    privileged_dim: int,
    num_state_costs: int,
) -> Composite:
    """What a step shows besides reward terms and done flags; the leading axis is num_envs."""
    costs = {keys.STATE_COSTS: Unbounded(_shape(batch, num_state_costs), device=device)}
    scalar = partial(Unbounded, shape=_shape(batch, 1), device=device)
    return Composite(
        {
            keys.OBSERVATION: Unbounded(_shape(batch, observation_dim), device=device),
            keys.PRIVILEGED: Unbounded(_shape(batch, privileged_dim), device=device),
            **(costs if num_state_costs else {}),
            keys.UPPER_BODY_ERROR: scalar(),
            keys.LOWER_BODY_ERROR: scalar(),
            keys.JOINT_ERROR: scalar(),
            keys.PHASE: scalar(),
            keys.FELL: _flag(batch, device),
            keys.UNSTABLE: _flag(batch, device),
        },
        shape=batch,
        device=device,
    )


def action_spec(batch: torch.Size, device: torch.device, num_joints: int) -> Bounded:
    """Raw actions; the bounds only exclude numbers that no policy means."""
    return Bounded(-1e3, 1e3, _shape(batch, num_joints), device=device)


def reward_terms_spec(batch: torch.Size, device: torch.device, num_terms: int) -> Composite:
    """The vector of raw terms takes the place of a reward, for which TorchRL asks."""
    terms = Unbounded(_shape(batch, num_terms), device=device)
    return Composite({keys.REWARD_TERMS: terms}, shape=batch, device=device)


def done_spec(batch: torch.Size, device: torch.device) -> Composite:
    """Failure (terminated), end of the motion (truncated), and either of them (done)."""
    names = (keys.DONE, keys.TERMINATED, keys.TRUNCATED)
    return Composite({name: _flag(batch, device) for name in names}, shape=batch, device=device)


def cleared_entries(batch: torch.Size, device: torch.device) -> dict[str, Tensor]:
    """The entries of ``CLEARED_BY_RESET`` at the start of an episode, zeros [num_envs, 1]."""
    return {
        key: torch.zeros(*batch, 1, dtype=dtype, device=device)
        for key, dtype in CLEARED_BY_RESET.items()
    }


def _flag(batch: torch.Size, device: torch.device) -> Binary:
    return Binary(n=1, shape=_shape(batch, 1), dtype=torch.bool, device=device)


def _shape(batch: torch.Size, width: int) -> torch.Size:
    return torch.Size((*batch, width))
