"""LocoMuJoCo's ``.npz`` (1.0 and later): MuJoCo's ``qpos`` with the names of its joints."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tlr_exp.motion.importers.raw import (
    Conventions,
    FileBodies,
    MotionFileError,
    Options,
    Recorded,
    take,
    take_names,
    take_rate,
)
from tlr_exp.robot.spec import RobotSpec


def read(content: Mapping[str, Any], options: Options, spec: RobotSpec) -> Recorded:
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
    part = choose_part(content, len(qpos), options)
    bodies = _bodies(content, len(qpos))
    if bodies is not None:
        bodies = FileBodies(bodies.pos[part], bodies.names)
    rate = take_rate(content, "frequency", options)
    root, quats, joints = np.split(qpos[part], [3, 7], axis=1)
    return Recorded(rate, root, quats, joints, names, Conventions(), bodies)


def choose_part(content: Mapping[str, Any], frames: int, options: Options) -> slice:
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


def _bodies(content: Mapping[str, Any], frames: int) -> FileBodies | None:
    # What LocoMuJoCo was not asked to store is there as None, or as an array without elements.
    positions = content.get("xpos")
    if content.get("body_names") is None or not isinstance(positions, np.ndarray):
        return None
    if not positions.size:
        return None
    names = take_names(content, "body_names")
    return FileBodies(take(content, "xpos", len(names), 3, frames=frames), names)
