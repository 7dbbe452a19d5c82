"""An engine whose every state is known: it plays the reference back."""

import torch
from torch import Tensor

from tlr_exp.motion.reference import Reference
from tlr_exp.physics.state import PhysicsState


class Playback:
    """A robot that is always exactly on the reference, ``ahead`` frames further than asked to be.

    ``shift_m`` [num_envs, 3] moves whole robots off the reference; ``change`` may edit a state
    before it is handed out.
    """

    control_dt = 0.02
    device = torch.device("cpu")

    def __init__(self, reference: Reference, num_envs: int, ahead: int = 0) -> None:
        self.num_envs = num_envs
        self.reference = reference
        self.ahead = ahead
        self.frame = torch.zeros(num_envs, dtype=torch.int64)
        self.shift_m = torch.zeros(num_envs, 3)
        self.change = lambda state: state
        self.targets: list[Tensor] = []
        self._all_qpos = reference.frame(torch.arange(reference.num_frames)).qpos

    def step(self, joint_target: Tensor) -> PhysicsState:
        self.targets.append(joint_target)
        self.frame = self.frame + 1
        return self.change(self._state(self.ahead))

    def set_state(self, env_ids: Tensor, qpos: Tensor, qvel: Tensor) -> None:
        same = (self._all_qpos[None] == qpos[:, None]).all(dim=-1)
        self.frame[env_ids] = same.int().argmax(dim=1)

    def state(self) -> PhysicsState:
        return self._state(0)

    def _state(self, ahead: int) -> PhysicsState:
        frame = self.reference.frame(self.frame + ahead)
        fields = {name: value.clone() for name, value in frame._asdict().items()}
        fields["qpos"][:, :3] += self.shift_m
        fields["body_pos_w"] += self.shift_m[:, None]
        return PhysicsState(
            **fields,
            joint_torque=torch.zeros(self.num_envs, 23),
            foot_contact_force=torch.zeros(self.num_envs, 2, 3),
        )
