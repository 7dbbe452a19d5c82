"""Lets a policy act without exploration noise and notes what each robot does."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from tensordict import TensorDictBase
from torchrl.envs.utils import ExplorationType, set_exploration_type, step_mdp

from tlr_exp import keys
from tlr_exp.errors import UserError
from tlr_exp.evaluation.trajectory import Trajectory
from tlr_exp.machine.cores import one_torch_thread

# What is noted of the physics state after every step, as the trajectory names it.
_OF_THE_STATE = ("qpos", "qvel", "joint_torque", "body_pos_w")


@torch.no_grad()
def rollout(
    env: Any,
    policy: Callable[[TensorDictBase], TensorDictBase],
    num_steps: int | None = None,
) -> list[Trajectory]:
    """Let the policy act until the motion ends; one item per robot.

    All robots step together; the trajectory of each ends where its motion does.

    Args:
        env: a ``TrackingEnv`` that starts at known frames, without failures.
        policy: writes the action into a tensordict that holds the observation.
        num_steps: stop after this many control steps; the whole motion by default.

    Raises:
        ValueError: the environment can end an episode by a failure.
    """
    if env.failures:
        raise UserError("an evaluation needs an environment with failures=False")
    rows: dict[str, list[torch.Tensor]] = {
        name: [] for name in (*_OF_THE_STATE, "terms", "unstable")
    }
    deterministic = set_exploration_type(ExplorationType.DETERMINISTIC)
    with deterministic, one_torch_thread(env.device.type):
        now = env.reset()
        starts = env.start_frame.tolist()
        available = env.starts.num_starts  # steps from frame 0: of the last start there is one
        lengths = [min(num_steps or available, available - start) for start in starts]
        for _ in range(max(lengths)):
            stepped = env.step(policy(now))
            for name in _OF_THE_STATE:
                rows[name].append(getattr(env.state, name))
            rows["terms"].append(stepped["next", keys.REWARD_TERMS])
            rows["unstable"].append(stepped["next", keys.UNSTABLE][:, 0])
            now = step_mdp(stepped)
    arrays = {name: _to_numpy(torch.stack(values, dim=1)) for name, values in rows.items()}
    return [
        _trajectory(env, {name: array[robot, :length] for name, array in arrays.items()}, start)
        for robot, (start, length) in enumerate(zip(starts, lengths, strict=True))
    ]


def _trajectory(env: Any, rows: Mapping[str, np.ndarray], start: int) -> Trajectory:
    """What one robot did from frame ``start``, beside the reference; ``rows`` are [T, ...]."""
    steps = torch.arange(1, len(rows["qpos"]) + 1, device=env.device)
    reference = env.reference.frame(start + steps + env.settings.reference_lead)
    return Trajectory(
        spec=env.spec,
        control_dt_s=env.physics.control_dt,
        **{name: rows[name] for name in _OF_THE_STATE},
        reference_qpos=_to_numpy(reference.qpos),
        reference_qvel=_to_numpy(reference.qvel),
        reference_body_pos_w=_to_numpy(reference.body_pos_w),
        terms=dict(zip(env.term_names, rows["terms"].T, strict=True)),
        unstable=rows["unstable"].astype(bool),
    )


def _to_numpy(tensor: torch.Tensor) -> np.ndarray:
    return tensor.cpu().double().numpy()
