"""What every motion clip must satisfy: one function a property, each raising ``ValueError``."""

import numpy as np

from tlr_exp.robot.g1 import JOINT_NAMES, TRACKED_BODIES

# Columns of qpos and qvel: MuJoCo's free joint, then the joints in the order of JOINT_NAMES.
ROOT_QUAT = slice(3, 7)
QPOS_JOINTS = slice(7, None)
NUM_QPOS = 7 + len(JOINT_NAMES)
NUM_QVEL = 6 + len(JOINT_NAMES)

UNIT_QUAT_TOLERANCE = 1e-3

ARRAY_SHAPES = {
    "qpos": (NUM_QPOS,),
    "qvel": (NUM_QVEL,),
    "body_pos_w": (len(TRACKED_BODIES), 3),
    "body_quat_w": (len(TRACKED_BODIES), 4),
    "body_lin_vel_w": (len(TRACKED_BODIES), 3),
    "body_ang_vel_w": (len(TRACKED_BODIES), 3),
}
BODY_ARRAYS = tuple(key for key in ARRAY_SHAPES if key.startswith("body"))


def check_names(kind: str, names: tuple[str, ...], ours: tuple[str, ...]) -> None:
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
    raise ValueError(
        f"motion clip: the {kind} names are not those of the 23-joint G1; "
        f"{'; '.join(parts)}; the clip has: {', '.join(names)}"
    )


def check_shapes(arrays: dict[str, np.ndarray]) -> None:
    frames = len(arrays["qpos"]) if arrays["qpos"].ndim else 0
    for key, array in arrays.items():
        if array.shape != (frames, *ARRAY_SHAPES[key]):
            expected = ", ".join(str(n) for n in ("T", *ARRAY_SHAPES[key]))
            raise ValueError(
                f"motion clip: {key} is {list(array.shape)}; expected [{expected}] "
                f"with the T = {frames} of qpos"
            )
    if frames < 2:
        raise ValueError(f"motion clip: it has {frames} frame(s); a motion needs at least 2")


def check_fps(fps: float) -> None:
    if not (np.isfinite(fps) and fps > 0):
        raise ValueError(f"motion clip: fps is {fps}; it must be a positive number")


def check_finite(key: str, array: np.ndarray) -> None:
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        raise ValueError(f"motion clip: {key}{bad[0].tolist()} is {array[tuple(bad[0])]}")


def check_unit(what: str, quats: np.ndarray) -> None:
    error = np.abs(np.linalg.norm(quats, axis=-1) - 1)
    if error.max() > UNIT_QUAT_TOLERANCE:
        where = tuple(int(i) for i in np.unravel_index(error.argmax(), error.shape))
        raise ValueError(
            f"motion clip: {what} holds a quaternion of norm "
            f"{np.linalg.norm(quats[where]):.4g} at {list(where)}; expected 1"
        )


def same_motion(first: np.ndarray, second: np.ndarray) -> bool:
    """Whether two clips' qpos [T, nq] agree to a micrometre: other machines round differently."""
    return first.shape == second.shape and np.allclose(first, second, rtol=0.0, atol=1e-6)
