"""The video of an evaluation: the robot, its reference as a ghost, time and errors written in."""

from pathlib import Path

import numpy as np

from tlr_exp.evaluation.distances import body_distance
from tlr_exp.evaluation.trajectory import Trajectory
from tlr_exp.pictures.clip_pictures import FOLLOW_HEIGHT_S, FOLLOW_S
from tlr_exp.pictures.framing import frame_robots
from tlr_exp.pictures.media import write_video
from tlr_exp.pictures.render import Camera, follow_pelvis, render_frames
from tlr_exp.robot.model import Robot

FRAME_RATE_HZ = 25.0


def film_evaluation(
    path: str | Path,
    robot: Robot,
    trajectory: Trajectory,
    *,
    width: int = 640,
    height: int = 480,
    camera: Camera | None = None,
    quality: str = "fast",
) -> Path:
    """Write the trajectory as an MP4 that runs in real time.

    Args:
        path: the file; its folder must exist.
        robot: from ``build_robot(visuals=True)``.
        trajectory: from ``tlr_exp.evaluation.rollout``.
        width, height, camera, quality: as ``render_frames``.

    Raises:
        GraphicsUnavailable: nothing can be drawn on this machine; no file is left.
        StorageError: the file cannot be written.
    """
    stride = max(1, round(1.0 / (trajectory.control_dt_s * FRAME_RATE_HZ)))
    shown = np.arange(0, trajectory.num_steps, stride)
    qpos, reference = trajectory.qpos[shown], trajectory.reference_qpos[shown]
    lookat = camera_path(trajectory)[shown]
    if camera is None:
        bodies = [trajectory.reference_body_pos_w[shown], trajectory.body_pos_w[shown]]
        camera, lookat = frame_robots(bodies, lookat, qpos[0], width / height)
    frames = render_frames(
        robot,
        qpos,
        reference,
        width=width,
        height=height,
        camera=camera,
        lookat=lookat,
        captions=captions(trajectory, shown),
        quality=quality,
    )
    return write_video(path, frames, 1.0 / (stride * trajectory.control_dt_s))


def camera_path(trajectory: Trajectory) -> np.ndarray:
    """The points [T, 3] in m at which the camera looks: between the robot and its reference.

    At the reference's height, so that a robot that falls does not draw the camera down with it and
    the reference out of the picture.
    """
    middle = (trajectory.qpos[:, :3] + trajectory.reference_qpos[:, :3]) / 2
    path = follow_pelvis(middle, FOLLOW_S / trajectory.control_dt_s)
    height = follow_pelvis(trajectory.reference_qpos, FOLLOW_HEIGHT_S / trajectory.control_dt_s)
    path[:, 2] = height[:, 2]
    return path


def captions(trajectory: Trajectory, shown: np.ndarray) -> list[str]:
    """Time, phase and the errors of the steps ``shown``, one text each."""
    distance = body_distance(trajectory.body_pos_w, trajectory.reference_body_pos_w)
    spec = trajectory.spec
    upper, lower = (distance[:, b].mean(axis=1) for b in (spec.upper_body, spec.lower_body))
    return [
        f"{(k + 1) * trajectory.control_dt_s:.2f} s   phase {(k + 1) / trajectory.num_steps:.2f}\n"
        f"upper body {upper[k]:.3f} m   lower body {lower[k]:.3f} m"
        for k in shown
    ]
