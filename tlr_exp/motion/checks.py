"""Checks what every motion clip must satisfy: one function a property, raising ``ValueError``."""

import numpy as np

from tlr_exp.errors import UserError
from tlr_exp.robot.spec import RobotSpec

# Columns of qpos: MuJoCo's free joint, then the robot's joints in their order.
ROOT_QUAT = slice(3, 7)
QPOS_JOINTS = slice(7, None)

UNIT_QUAT_TOLERANCE = 1e-3

BODY_WIDTHS = {"body_pos_w": 3, "body_quat_w": 4, "body_lin_vel_w": 3, "body_ang_vel_w": 3}
ARRAYS = ("qpos", "qvel", *BODY_WIDTHS)


def array_shapes(spec: RobotSpec) -> dict[str, tuple[int, ...]]:
    """The shape of one frame of each of ``ARRAYS``."""
    bodies = {key: (spec.num_bodies, width) for key, width in BODY_WIDTHS.items()}
    return {"qpos": (spec.num_qpos,), "qvel": (spec.num_qvel,), **bodies}


def check_names(spec: RobotSpec, joints: tuple[str, ...], bodies: tuple[str, ...]) -> None:
    """Refuse names of joints or bodies that are not the robot's in their order."""
    _check_names(spec, "joint", joints, spec.joint_names)
    _check_names(spec, "body", bodies, spec.tracked_bodies)


def _check_names(spec: RobotSpec, kind: str, names: tuple[str, ...], ours: tuple[str, ...]) -> None:
    if names == ours:
        return
    missing = [name for name in ours if name not in names]
    unknown = [name for name in names if name not in ours]
    parts = []
    if missing:
        parts.append(f"missing: {', '.join(missing)}")
    if unknown:
        parts.append(f"unknown: {', '.join(unknown)}")
    if not parts:
        parts.append(f"the order or number differs: expected {', '.join(ours)}")
    raise UserError(
        f"motion clip: the {kind} names are not those of the {spec.num_joints}-joint {spec.name}; "
        f"{'; '.join(parts)}; the clip has: {', '.join(names)}"
    )


def check_shapes(arrays: dict[str, np.ndarray], spec: RobotSpec) -> None:
    shapes = array_shapes(spec)
    frames = len(arrays["qpos"]) if arrays["qpos"].ndim else 0
    for key, array in arrays.items():
        if array.shape != (frames, *shapes[key]):
            expected = ", ".join(str(n) for n in ("T", *shapes[key]))
            raise UserError(
                f"motion clip: {key} is {list(array.shape)}; expected [{expected}] "
                f"with the T = {frames} of qpos"
            )
    if frames < 2:
        raise UserError(f"motion clip: it has {frames} frame(s); a motion needs at least 2")


def check_fps(fps: float) -> None:
    if not (np.isfinite(fps) and fps > 0):
        raise UserError(f"motion clip: fps is {fps}; it must be a positive number")


def check_finite(key: str, array: np.ndarray) -> None:
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        raise UserError(f"motion clip: {key}{bad[0].tolist()} is {array[tuple(bad[0])]}")


def check_unit(what: str, quats: np.ndarray) -> None:
    error = np.abs(np.linalg.norm(quats, axis=-1) - 1)
    if error.max() > UNIT_QUAT_TOLERANCE:
        where = tuple(int(i) for i in np.unravel_index(error.argmax(), error.shape))
        raise UserError(
            f"motion clip: {what} holds a quaternion of norm "
            f"{np.linalg.norm(quats[where]):.4g} at {list(where)}; expected 1"
        )


def same_motion(first: np.ndarray, second: np.ndarray) -> bool:
    """Whether two clips' qpos [T, nq] agree to a micrometre: other machines round differently."""
    return first.shape == second.shape and np.allclose(first, second, rtol=0.0, atol=1e-6)
