"""Films of recordings: the robot, its reference as a ghost, time and errors written in."""

from collections.abc import Callable
from pathlib import Path

from tlr_exp.pictures.framing import camera_for, camera_path
from tlr_exp.pictures.media import write_video
from tlr_exp.pictures.recording import Recording
from tlr_exp.pictures.render import render_frames
from tlr_exp.robot.model import Robot

FRAME_RATE_HZ = 25.0


def film(
    path: str | Path,
    robot: Robot,
    recording: Recording,
    *,
    heading: str = "",
    width: int = 640,
    height: int = 480,
    frame_rate_hz: float = FRAME_RATE_HZ,
    quality: str = "fast",
    drawn: Callable[[int], None] = lambda _: None,
) -> Path:
    """Write a recording as an MP4 that runs in real time, the camera going along.

    Args:
        path: the file; its folder must exist.
        robot: from ``build_robot(visuals=True)``.
        recording: the states, their reference and captions.
        heading: a line above each caption.
        width, height, quality: as ``render_frames``.
        frame_rate_hz: of the video, about: whole states of the recording are left out.
        drawn: told after each frame how many there are.

    Raises:
        GraphicsUnavailable: nothing can be drawn on this machine; no file is left.
        ValueError: the frame rate is not positive; as ``render_frames``.
        StorageError: the file cannot be written.
    """
    shown = recording.frames_at_rate(frame_rate_hz)
    camera, lookat = camera_for(recording, camera_path(recording), shown, width / height)
    reference = recording.reference_qpos
    frames = render_frames(
        robot,
        recording.qpos[shown],
        None if reference is None else reference[shown],
        width=width,
        height=height,
        camera=camera,
        lookat=lookat,
        captions=[f"{heading}\n{recording.captions[k]}".lstrip("\n") for k in shown],
        quality=quality,
    )

    def counted():
        for number, frame in enumerate(frames, start=1):
            yield frame
            drawn(number)

    return write_video(path, counted(), recording.rate_of(shown))
