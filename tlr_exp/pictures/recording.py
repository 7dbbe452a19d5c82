"""Saved states of a robot with all that films, strips and viewers show of them."""

from dataclasses import dataclass

import numpy as np

from tlr_exp.errors import UserError
from tlr_exp.evaluation.distances import body_distance
from tlr_exp.evaluation.trajectory import Trajectory
from tlr_exp.motion.clip import MotionClip


@dataclass(frozen=True)
class Recording:
    """T states of a robot at equal distances in time, float64, world frame, SI units.

    Attributes:
        title: what it is of.
        dt_s: time between two states.
        qpos: [T, 30] (m, wxyz quaternion, rad).
        reference_qpos: [T, 30], drawn translucent; or None.
        captions: one text for each state, of one or several lines.
        start_s: time of the first state, for the slider alone.
        bodies: positions [T, bodies, 3] of the robot's bodies, before them those of the reference:
            what a camera is to have in its pictures.

    Raises:
        ValueError: shapes that do not fit, values that are not finite, a time that is not positive.
    """

    title: str
    dt_s: float
    qpos: np.ndarray
    reference_qpos: np.ndarray | None
    captions: tuple[str, ...]
    start_s: float = 0.0
    bodies: tuple[np.ndarray, ...] = ()

    def __post_init__(self) -> None:
        if not (np.isfinite(self.dt_s) and self.dt_s > 0):
            raise UserError(f"dt_s is {self.dt_s}; it must be positive")
        if self.qpos.ndim != 2 or len(self.qpos) == 0:
            raise UserError(f"qpos has the shape {self.qpos.shape}; expected [T, 30], T > 0")
        reference = self.qpos if self.reference_qpos is None else self.reference_qpos
        if reference.shape != self.qpos.shape:
            raise UserError(f"reference_qpos is {reference.shape}, but qpos {self.qpos.shape}")
        if not (np.isfinite(self.qpos).all() and np.isfinite(reference).all()):
            raise UserError("the states hold values that are not finite")
        if len(self.captions) != len(self.qpos):
            raise UserError(f"{len(self.captions)} captions for {len(self.qpos)} states")

    @property
    def num_frames(self) -> int:
        return len(self.qpos)

    @property
    def duration_s(self) -> float:
        """Time from the first state to the last."""
        return (self.num_frames - 1) * self.dt_s

    def frames_at_rate(self, frame_rate_hz: float) -> np.ndarray:
        """The states [n] that a film of about this rate shows: evenly spaced, two if there are.

        Raises:
            ValueError: the rate is not positive.
        """
        if not (np.isfinite(frame_rate_hz) and frame_rate_hz > 0):
            raise UserError(f"the video's frame rate is {frame_rate_hz:g}; it must be positive")
        stride = round(1 / (self.dt_s * frame_rate_hz))
        return np.arange(0, self.num_frames, max(1, min(stride, self.num_frames - 1)))

    def rate_of(self, frames: np.ndarray) -> float:
        """How many of these evenly spaced states there are in a second; of one, as of all."""
        stride = frames[1] - frames[0] if len(frames) > 1 else 1
        return 1 / (stride * self.dt_s)

    def frames_at(self, times_s: np.ndarray) -> np.ndarray:
        """The states [n] nearest to ``times_s`` [n].

        Raises:
            ValueError: a time is not within the recording.
        """
        within = (times_s >= 0) & (times_s <= self.duration_s + 0.5 * self.dt_s)
        if not within.all():
            wrong = times_s[~within][0]
            raise UserError(f"{wrong:g} s is not within the clip of {self.duration_s:.2f} s")
        return np.minimum(np.rint(times_s / self.dt_s).astype(int), self.num_frames - 1)


def recording_of_clip(clip: MotionClip, title: str) -> Recording:
    """A clip, without a reference; the texts are time and phase."""
    texts = tuple(
        f"{frame / clip.fps:.2f} s of {clip.duration_s:.2f} s   "
        f"phase {frame / (clip.num_frames - 1):.2f}"
        for frame in range(clip.num_frames)
    )
    return Recording(title, 1.0 / clip.fps, clip.qpos, None, texts, bodies=(clip.body_pos_w,))


def recording_of_trajectory(trajectory: Trajectory, title: str) -> Recording:
    """A policy's roll-out with its reference; the texts are time, phase and errors."""
    bodies = (trajectory.reference_body_pos_w, trajectory.body_pos_w)
    distance = body_distance(trajectory.body_pos_w, trajectory.reference_body_pos_w)
    spec = trajectory.spec
    upper, lower = (distance[:, b].mean(axis=1) for b in (spec.upper_body, spec.lower_body))
    dt_s = trajectory.control_dt_s  # the first row is the end of the first step
    texts = tuple(
        f"{(k + 1) * dt_s:.2f} s   phase {(k + 1) / trajectory.num_steps:.2f}\n"
        f"upper body {upper[k]:.3f} m   lower body {lower[k]:.3f} m"
        for k in range(trajectory.num_steps)
    )
    return Recording(
        *(title, dt_s, trajectory.qpos, trajectory.reference_qpos, texts),
        start_s=dt_s,
        bodies=bodies,
    )
