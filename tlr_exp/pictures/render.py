"""Pictures of the robot from saved states.

Nothing here runs while the robot moves: a picture needs the states alone, so that a machine
without graphics trains as well as any other and only its pictures are missing.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from tlr_exp.errors import UserError
from tlr_exp.motion.checks import ROOT_QUAT
from tlr_exp.motion.quaternions import heading
from tlr_exp.pictures.studio import QUALITIES, Studio
from tlr_exp.robot.model import Robot

_INK = (25, 30, 40)


@dataclass(frozen=True)
class Camera:
    """From where a camera looks.

    ``azimuth_deg`` is relative to where the robot faces in the first frame: 180 looks it in the
    face, 0 at its back, 90 at its right side.
    """

    azimuth_deg: float = 150.0
    elevation_deg: float = -10.0
    distance_m: float = 2.5


_USUAL = Camera()


def render_frames(
    robot: Robot,
    qpos: np.ndarray,
    ghost_qpos: np.ndarray | None = None,
    *,
    width: int = 640,
    height: int = 480,
    camera: Camera = _USUAL,
    lookat: np.ndarray | None = None,
    captions: Sequence[str] | None = None,
    quality: str = "fast",
) -> Iterator[np.ndarray]:
    """Draw saved states one after another.

    Args:
        robot: from ``build_robot(visuals=True)``; without meshes its collision shapes are drawn.
        qpos: generalised positions [T, 30] (m, wxyz quaternion, rad).
        ghost_qpos: the reference, drawn translucent over the robot [T, 30].
        width, height: of a frame, pixels.
        camera: where it looks from.
        lookat: the point in the middle of each frame [T, 3], m; the pelvis by default.
        captions: one text a frame, written in the upper left corner; may have several lines.
        quality: ``fast`` (videos) or ``full`` (pictures for print).

    Returns:
        An iterator of T frames, uint8 [height, width, 3]. It holds the graphics context until it
        is exhausted or closed.

    Raises:
        GraphicsUnavailable: nothing can be drawn on this machine.
        ValueError: arrays of the wrong shape or with values that are not finite; an unknown
            quality.
    """
    if quality not in QUALITIES:
        raise UserError(f"quality is {quality!r}; allowed are {', '.join(QUALITIES)}")
    qpos = _checked("qpos", qpos, (len(qpos), robot.model.nq))
    ghosts = [None] * len(qpos)
    if ghost_qpos is not None:
        ghosts = _checked("ghost_qpos", ghost_qpos, qpos.shape)
    path = _checked("lookat", qpos[:, :3] if lookat is None else lookat, (len(qpos), 3))
    if captions is not None and len(captions) != len(qpos):
        raise UserError(f"{len(captions)} captions for {len(qpos)} frames")
    studio = Studio(
        robot.model,
        width,
        height,
        azimuth_deg=math.degrees(heading(qpos[0, ROOT_QUAT])) + camera.azimuth_deg,
        elevation_deg=camera.elevation_deg,
        distance_m=camera.distance_m,
        quality=QUALITIES[quality],
    )
    return _drawn(studio, zip(qpos, ghosts, path, captions or [""] * len(qpos), strict=True))


def _drawn(studio: Studio, states: Iterable[tuple]) -> Iterator[np.ndarray]:
    """A frame for each state, ghost, point looked at and caption; the studio is closed with it."""
    try:
        for qpos, ghost, lookat, text in states:
            frame = studio.frame(qpos, ghost, lookat)
            yield caption(frame, text) if text else frame
    finally:
        studio.close()


def caption(frame: np.ndarray, text: str) -> np.ndarray:
    """Write a text into the upper left corner of a frame, uint8 [height, width, 3]."""
    image = Image.fromarray(frame)
    size = max(10, frame.shape[0] // 26)
    ImageDraw.Draw(image).text(
        (size * 0.7, size * 0.6), text, fill=_INK, font=ImageFont.load_default(size)
    )
    return np.asarray(image)


def _checked(name: str, array: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    array = np.asarray(array, dtype=np.float64)
    if array.shape != shape or len(array) == 0:
        raise UserError(f"{name} has the shape {array.shape}, expected {shape}, at least one row")
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if len(bad):
        raise UserError(f"{name}: frame {bad[0]} holds values that are not finite")
    return array
