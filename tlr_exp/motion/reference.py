"""``Reference``: a clip as float32 tensors, looked up for many environments at once."""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from tlr_exp.motion.checks import ARRAY_SHAPES, ROOT_QUAT
from tlr_exp.motion.clip import MotionClip


class ReferenceFrame(NamedTuple):
    """The reference of n environments at one instant each, float32; conventions of MotionClip.

    The tensors are views of one buffer that belongs to this frame alone.
    """

    qpos: Tensor  # [n, 30]
    qvel: Tensor  # [n, 29]
    body_pos_w: Tensor  # [n, 27, 3]
    body_quat_w: Tensor  # [n, 27, 4]
    body_lin_vel_w: Tensor  # [n, 27, 3]
    body_ang_vel_w: Tensor  # [n, 27, 3]


class Reference:
    """Look-up of a clip by frame number or by time.

    Args:
        clip: the motion.
        device: where the tensors live.

    Attributes:
        fps: frames a second.
        num_frames: number of frames.
        duration_s: time of the last frame.
        device: the tensors' device.
    """

    def __init__(self, clip: MotionClip, device: torch.device | str = "cpu") -> None:
        self.fps = clip.fps
        self.num_frames = clip.num_frames
        self.duration_s = clip.duration_s
        self.device = torch.device(device)
        # One row a frame holds everything, so that a look-up is a single gather.
        rows = [getattr(clip, key).reshape(clip.num_frames, -1) for key in ReferenceFrame._fields]
        self._rows = torch.as_tensor(np.hstack(rows), dtype=torch.float32, device=self.device)
        self._widths = [row.shape[1] for row in rows]
        first = sum(self._widths[: ReferenceFrame._fields.index("body_quat_w")])
        # The columns that are interpolated on the sphere: the root's quaternion, every body's.
        self._quats = (ROOT_QUAT, slice(first, first + 4 * clip.body_quat_w.shape[1]))
        self._angles = tuple(
            _step_angles(self._rows[:, columns].double()).float() for columns in self._quats
        )

    def frame(self, index: Tensor) -> ReferenceFrame:
        """The reference at whole frames.

        Args:
            index: [n] int64, frame numbers; those outside the clip take its first or last frame.
        """
        return self._split(self._rows.index_select(0, index.clamp(0, self.num_frames - 1)))

    def at(self, time_s: Tensor) -> ReferenceFrame:
        """The reference at any times: linear interpolation, slerp for quaternions.

        Args:
            time_s: [n] float, seconds; times outside the clip take its first or last frame.
        """
        position = (time_s * self.fps).clamp(0, self.num_frames - 1)
        low = position.long().clamp(max=self.num_frames - 2)
        part = (position - low).to(torch.float32)[:, None]
        start, end = self._rows.index_select(0, low), self._rows.index_select(0, low + 1)
        rows = torch.lerp(start, end, part)
        for columns, angles in zip(self._quats, self._angles, strict=True):
            angle = angles.index_select(0, low)
            sine = angle.sin()
            start_share = (((1 - part) * angle).sin() / sine).unsqueeze(-1)
            end_share = ((part * angle).sin() / sine).unsqueeze(-1)
            quats = start[:, columns].unflatten(1, (-1, 4)) * start_share
            quats += end[:, columns].unflatten(1, (-1, 4)) * end_share
            rows[:, columns] = quats.flatten(1)
        return self._split(rows)

    def _split(self, rows: Tensor) -> ReferenceFrame:
        parts = rows.split(self._widths, dim=1)
        return ReferenceFrame(
            *(
                part.unflatten(1, ARRAY_SHAPES[key]) if len(ARRAY_SHAPES[key]) > 1 else part
                for key, part in zip(ReferenceFrame._fields, parts, strict=True)
            )
        )


def _step_angles(quats: Tensor) -> Tensor:
    """Angle on the unit sphere from each frame's quaternions to the next; [T, 4 k] -> [T-1, k].

    At least 1e-3, where slerp and linear interpolation agree to float32 and sines are not yet 0.
    """
    quats = quats.unflatten(1, (-1, 4))
    start, end = quats[:-1], quats[1:]
    # The half-angle form stays exact for close quaternions, where acos loses digits.
    angle = 2 * torch.atan2((end - start).norm(dim=-1), (end + start).norm(dim=-1))
    return angle.clamp(min=1e-3)
