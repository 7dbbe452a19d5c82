"""Flight: while no foot touches the floor nothing can turn the robot but its own limbs.

The centre of mass falls freely (``balance.plan_height``), and the angular momentum about it stays
what it was at take-off. Limbs move as the script says; the pelvis turns so that the sum is kept.
"""

import mujoco
import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from tlr_exp.motion.authoring.script import KeyframeError
from tlr_exp.motion.clip import MotionClip
from tlr_exp.motion.dynamics import centroidal
from tlr_exp.robot.model import Robot

_LEAST_STAND_S = 0.1  # on the floor before, between and after flights
# Against one another: angular momentum that changes in flight (kg m^2/s), jerk of the turn
# (rad/s^3), the turn itself (rad), and its first and last three frames.
_MOMENTUM_WEIGHT, _JERK_WEIGHT, _TURN_WEIGHT, _END_WEIGHT = 100.0, 1e-3, 10.0, 1e3
_END_FRAMES = [*range(9), *range(-9, 0)]
# The smallest singular value of it that is believed, kg m^2: near a stretched leg a turn of the
# pelvis moves the leg much, and could seem to need no momentum.
_LEAST_INERTIA = 0.3


def flights(on_floor: np.ndarray, times_s: np.ndarray) -> list[tuple[int, int]]:
    """Take-off and landing frames: the last before and the first after each flight.

    Args:
        on_floor: [2, T] bool, whether each foot carries weight.
        times_s: [T].

    Raises:
        KeyframeError: too little time on the floor before, between or after flights.
    """
    flying = ~on_floor.any(axis=0)
    padded = np.concatenate([[False], flying, [False]])
    changes = np.flatnonzero(padded[1:] != padded[:-1]).reshape(-1, 2)
    spans = [(int(first) - 1, int(after)) for first, after in changes]
    ends = [0, *(frame for span in spans for frame in span), len(times_s) - 1]
    for start, end in zip(ends[::2], ends[1::2], strict=True):
        if spans and (end - start) * (times_s[1] - times_s[0]) < _LEAST_STAND_S:
            raise KeyframeError(
                f"the motion cannot be performed: about {times_s[max(end, 0)]:.2f} s it stands for "
                f"less than {_LEAST_STAND_S} s before, between or after flights, in which both "
                "feet move (a foot moves wherever a keyframe gives it another place)"
            )
    return spans


def momentum_turn(
    clip: MotionClip, robot: Robot, spans: list[tuple[int, int]], turn: np.ndarray
) -> np.ndarray:
    """How to turn the pelvis so that flights keep their angular momentum.

    Of all turns that do, the one that is smooth and small over the whole motion: least squares in
    the turn at each frame and the momentum of each flight, linear about the clip.

    Args:
        clip: what limbs and pelvis do so far.
        robot: gives the model.
        spans: take-off and landing frames, of ``flights``.
        turn: [T, 3], rotation vectors in rad, world frame, by which the clip's pelvis is already
            turned from what the script says.

    Returns:
        [T, 3], rotation vectors in place of ``turn``.
    """
    frames, unknowns = clip.num_frames, 3 * (clip.num_frames + len(spans))
    flying, wanted = _momentum_equations(clip, robot, spans, turn)
    jerk = np.diff(np.eye(frames), n=3, axis=0) * clip.fps**3
    calm = np.concatenate([_JERK_WEIGHT * jerk, _TURN_WEIGHT * np.eye(frames)])
    still = sparse.csr_array(sparse.kron(sparse.csr_array(calm), sparse.eye_array(3)))
    still.resize(3 * len(calm), unknowns)
    ends = _END_WEIGHT * sparse.csr_array(np.eye(3 * frames, unknowns)[_END_FRAMES])
    system = sparse.csr_array(sparse.vstack([_MOMENTUM_WEIGHT * flying, still, ends]))
    goal = system[: len(wanted)].T @ (_MOMENTUM_WEIGHT * wanted)  # all the rest should be zero
    solution = spsolve(sparse.csc_array(system.T @ system), goal)
    return np.asarray(solution)[: 3 * frames].reshape(frames, 3)


def _momentum_equations(
    clip: MotionClip, robot: Robot, spans: list[tuple[int, int]], turn: np.ndarray
) -> tuple[sparse.csr_array, np.ndarray]:
    """Rows A and values b: A x = b where x, the turn and a constant a flight, keeps momentum.

    Turning speeds are central differences, as those of the clip.
    """
    momentum, frames = centroidal(clip, robot).angular_momentum, clip.num_frames
    rows, wanted = [], []
    for number, (up, down) in enumerate(spans):
        for t in range(up, down + 1):
            inertia = turning_inertia(clip.qpos[t], robot)
            row = np.zeros((3, 3 * (frames + len(spans))))
            row[:, 3 * t - 3 : 3 * t] = -inertia * clip.fps / 2
            row[:, 3 * t + 3 : 3 * t + 6] = inertia * clip.fps / 2
            row[:, 3 * (frames + number) : 3 * (frames + number + 1)] = -np.eye(3)
            rows.append(row)
            speed = (turn[t + 1] - turn[t - 1]) * clip.fps / 2
            wanted.append(inertia @ speed - momentum[t])
    return sparse.csr_array(np.concatenate(rows)), np.concatenate(wanted)


def turning_inertia(qpos: np.ndarray, robot: Robot) -> np.ndarray:
    """Angular momentum [3, 3] in kg m^2/s of turning the pelvis by 1 rad/s about x, y, z.

    The feet, the centre of mass and the angles of waist and arms stay; the legs give way.
    """
    model, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    pelvis = robot.pelvis_id
    rows = []
    for body in robot.foot_body_ids:
        place, turn = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        mujoco.mj_jacBody(model, data, place, turn, int(body))
        rows += [place, turn]
    mass, turn = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_jacSubtreeCom(model, data, mass, pelvis)
    mujoco.mj_jacBody(model, data, None, turn, pelvis)
    upper = [6 + i for i in robot.spec.upper_joints]
    system = np.concatenate([*rows, mass, np.eye(model.nv)[upper], turn])
    motion = np.linalg.lstsq(system, np.eye(len(system))[:, -3:])[0]
    momentum = np.zeros((3, model.nv))
    mujoco.mj_angmomMat(model, data, momentum, pelvis)
    left, values, right = np.linalg.svd(momentum @ motion)
    return left @ np.diag(np.maximum(values, _LEAST_INERTIA)) @ right
