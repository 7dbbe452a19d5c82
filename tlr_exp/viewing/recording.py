"""What a viewer plays: states, a reference, texts; and the clock that plays them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tlr_exp.evaluation.trajectory import Trajectory
from tlr_exp.motion.clip import MotionClip
from tlr_exp.pictures.clip_pictures import moment
from tlr_exp.pictures.film import captions


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

    Raises:
        ValueError: shapes that do not fit, values that are not finite, a time that is not positive.
    """

    title: str
    dt_s: float
    qpos: np.ndarray
    reference_qpos: np.ndarray | None
    captions: tuple[str, ...]
    start_s: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.dt_s) and self.dt_s > 0):
            raise ValueError(f"dt_s is {self.dt_s}; it must be positive")
        if self.qpos.ndim != 2 or len(self.qpos) == 0:
            raise ValueError(f"qpos has the shape {self.qpos.shape}; expected [T, 30], T > 0")
        reference = self.qpos if self.reference_qpos is None else self.reference_qpos
        if reference.shape != self.qpos.shape:
            raise ValueError(f"reference_qpos is {reference.shape}, but qpos {self.qpos.shape}")
        if not (np.isfinite(self.qpos).all() and np.isfinite(reference).all()):
            raise ValueError("the states hold values that are not finite")
        if len(self.captions) != len(self.qpos):
            raise ValueError(f"{len(self.captions)} captions for {len(self.qpos)} states")

    @property
    def num_frames(self) -> int:
        return len(self.qpos)

    @property
    def duration_s(self) -> float:
        """Time from the first state to the last."""
        return (self.num_frames - 1) * self.dt_s


def recording_of_trajectory(trajectory: Trajectory, title: str) -> Recording:
    """A policy's roll-out with its reference; the texts are phase and errors."""
    texts = captions(trajectory, np.arange(trajectory.num_steps))
    dt_s = trajectory.control_dt_s  # the first row is the end of the first step
    return Recording(
        *(title, dt_s, trajectory.qpos, trajectory.reference_qpos, tuple(texts)), start_s=dt_s
    )


def recording_of_clip(clip: MotionClip, title: str) -> Recording:
    """A clip, without a reference; the texts are time and phase."""
    texts = tuple(moment(clip, frame) for frame in range(clip.num_frames))
    return Recording(title, 1.0 / clip.fps, clip.qpos, None, texts)


@dataclass
class Player:
    """Which state of a recording is shown as time goes by.

    Attributes:
        recording: what is played.
        playing: whether time goes by.
        loop: whether it begins again after the end; else it stops there.
        speed: seconds of the recording in a second.
    """

    recording: Recording
    playing: bool = True
    loop: bool = True
    speed: float = 1.0
    time_s: float = field(default=0.0, init=False)

    @property
    def frame(self) -> int:
        """The state that is shown now."""
        last = self.recording.num_frames - 1
        return min(int(self.time_s / self.recording.dt_s + 0.5), last)

    def seek(self, time_s: float) -> None:
        """Go to a time of the recording; beyond its ends, to its ends."""
        self.time_s = min(max(time_s, 0.0), self.recording.duration_s)

    def toggle(self) -> None:
        """Play or pause; at the end play from the beginning."""
        if not self.playing and self.frame == self.recording.num_frames - 1:
            self.time_s = 0.0
        self.playing = not self.playing

    def advance(self, elapsed_s: float) -> None:
        """Let ``elapsed_s`` go by on the wall clock.

        In a loop the last state is shown for as long as every other one.
        """
        if not self.playing:
            return
        time_s = self.time_s + self.speed * elapsed_s
        if self.loop:
            self.time_s = time_s % (self.recording.duration_s + self.recording.dt_s)
        else:
            self.seek(time_s)
            self.playing = time_s < self.recording.duration_s
