"""``Reference``: a clip as float32 tensors, looked up for many environments at once."""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from tlr_exp.errors import UserError
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
    """Look-up of a clip by frame number.

    Args:
        clip: the motion.
        device: where the tensors live.

    Attributes:
        fps: frames a second.
        num_frames: number of frames.
        device: the tensors' device.
    """

    def __init__(self, clip: MotionClip, device: torch.device | str = "cpu") -> None:
        self.fps = clip.fps
        self.num_frames = clip.num_frames
        self.device = torch.device(device)
        # One row a frame holds everything, so that a look-up is a single gather.
        arrays = [getattr(clip, key) for key in ReferenceFrame._fields]
        rows = [array.reshape(clip.num_frames, -1) for array in arrays]
        self._rows = torch.as_tensor(np.hstack(rows), dtype=torch.float32, device=self.device)
        self._widths = [row.shape[1] for row in rows]
        self._shapes = [array.shape[1:] for array in arrays]

    def check(self, control_dt_s: float, lead: int) -> None:
        """Refuse a motion at another rate than the control's, or too short to be read ahead.

        Args:
            control_dt_s: duration of a control step, seconds.
            lead: frames by which the motion is read ahead.

        Raises:
            UserError: says what is needed.
        """
        rate_hz = 1.0 / control_dt_s
        if abs(self.fps - rate_hz) > 1e-6:
            raise UserError(
                f"the motion has {self.fps:g} frames a second, the control rate is "
                f"{rate_hz:g} Hz: resample the clip first"
            )
        if self.num_frames < lead + 2:
            raise UserError(
                f"a motion needs at least {lead + 2} frames, this one has {self.num_frames}"
            )

    def frame(self, index: Tensor) -> ReferenceFrame:
        """The reference at whole frames.

        Args:
            index: [n] int64, frame numbers; those outside the clip take its first or last frame.
        """
        rows = self._rows.index_select(0, index.clamp(0, self.num_frames - 1))
        parts = rows.split(self._widths, dim=1)
        return ReferenceFrame(
            *(
                part.unflatten(1, shape) if len(shape) > 1 else part
                for shape, part in zip(self._shapes, parts, strict=True)
            )
        )
