"""LocoMuJoCo's ``.npz`` (1.0 and later): MuJoCo's ``qpos`` with the names of its joints."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tlr_exp.motion.importers.raw import (
    Bodies,
    MotionFileError,
    Options,
    RawMotion,
    assemble,
    take,
    take_names,
    take_rate,
    tracked,
)


def read(content: Mapping[str, Any], options: Options) -> list[RawMotion]:
    """The trajectory, or the one whose number (from 0) is ``options.motion``.

    Raises:
        MotionFileError: see ``raw``; or the file holds several trajectories and none is chosen.
    """
    names = take_names(content, "joint_names")
    qpos = take(content, "qpos", None)
    # The free joint of the root, whatever its name, comes first and has seven values.
    if qpos.shape[1] == 6 + len(names):
        names = names[1:]
    if qpos.shape[1] != 7 + len(names):
        raise MotionFileError(
            f"qpos has {qpos.shape[1]} columns; the {len(names)} joints of joint_names and a free "
            f"root have {7 + len(names)}"
        )
    part = _part(content, len(qpos), options)
    bodies = _bodies(content, len(qpos))
    if bodies is not None:
        bodies = Bodies(bodies.names, bodies.pos_w[part])
    qpos = qpos[part]
    qpos = assemble(qpos[:, :3], qpos[:, 3:7], qpos[:, 7:], names)
    return [RawMotion(take_rate(content, "frequency", options), qpos, bodies)]


def _part(content: Mapping[str, Any], frames: int, options: Options) -> slice:
    """The frames of one trajectory; ``split_points`` holds where each begins, and the end."""
    if "split_points" not in content:
        return slice(0, frames)
    points = [int(point) for point in take(content, "split_points")]
    count = len(points) - 1
    if count < 1 or points != sorted(points) or points[0] < 0 or points[-1] > frames:
        raise MotionFileError(f"split_points do not divide its {frames} frames")
    if options.motion is None and count > 1:
        raise MotionFileError(
            f"it has {count} trajectories; choose one by --motion NUMBER, 0 to {count - 1}"
        )
    numbers = [str(number) for number in range(count)]
    if options.motion is not None and options.motion not in numbers:
        raise MotionFileError(f"it has no trajectory {options.motion!r}; it has 0 to {count - 1}")
    first = int(options.motion or 0)
    return slice(points[first], points[first + 1])


def _bodies(content: Mapping[str, Any], frames: int) -> Bodies | None:
    # What LocoMuJoCo was not asked to store is there as None, or as an array without elements.
    positions = content.get("xpos")
    if content.get("body_names") is None or not isinstance(positions, np.ndarray):
        return None
    if not positions.size:
        return None
    names = take_names(content, "body_names")
    return tracked(names, take(content, "xpos", len(names), 3, frames=frames))
