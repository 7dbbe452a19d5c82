"""A file's body positions beside forward kinematics of our robot, and the joint order they tell."""

from dataclasses import dataclass, replace

import numpy as np

from tlr_exp.motion.clip import body_states
from tlr_exp.motion.importers.raw import (
    Bodies,
    Conventions,
    ImplausibleError,
    MotionFileError,
    RawMotion,
    Recorded,
    thinned,
)
from tlr_exp.motion.importers.readings.conventions import interpret
from tlr_exp.motion.importers.readings.joints import ORDERS
from tlr_exp.robot.model import Robot
from tlr_exp.robot.spec import RobotSpec

_COMPARED_FRAMES = 50
# Bodies without names are no proof of a joint order unless each of our links is found among them.
FOUND_M = 0.03


@dataclass(frozen=True)
class KinematicsGap:
    """How far a file's body positions are from forward kinematics of our robot."""

    max_m: float
    mean_m: float
    body: str
    frame: int


def kinematics_gap(qpos: np.ndarray, bodies: Bodies, robot: Robot) -> KinematicsGap:
    """Compare body positions [T, n, 3] with forward kinematics of ``qpos`` [T, 30].

    Without names, each link of ours is compared with the nearest of the file's bodies.
    """
    ours = body_states(robot, qpos, np.zeros((len(qpos), robot.model.nv)))["body_pos_w"]
    distance = distances(ours, bodies, robot.spec)
    names = robot.spec.link_names if bodies.names is None else bodies.names
    frame, body = np.unravel_index(distance.argmax(), distance.shape)
    return KinematicsGap(float(distance.max()), float(distance.mean()), names[body], int(frame))


def distances(ours: np.ndarray, bodies: Bodies, spec: RobotSpec) -> np.ndarray:
    """Of each compared body from ours [T, 27, 3], in metres: [T, n], or [T, 24] without names."""
    names = spec.link_names if bodies.names is None else bodies.names
    ours = ours[:, spec.bodies(names)]
    if bodies.names is not None:
        return np.linalg.norm(ours - bodies.pos_w, axis=-1)
    nearest = [
        np.linalg.norm(bodies.pos_w - ours[:, [i]], axis=-1).min(axis=1) for i in range(len(names))
    ]
    return np.stack(nearest, axis=1)


def with_order(recorded: Recorded, conventions: Conventions, robot: Robot) -> RawMotion:
    """The motion, its joint order told by the bodies where the format leaves it open.

    Raises:
        MotionFileError: see ``interpret``; or the bodies do not tell.
    """
    if conventions.joint_order != "open":
        return interpret(recorded, conventions, robot.spec)
    readings = [
        interpret(recorded, replace(conventions, joint_order=order), robot.spec) for order in ORDERS
    ]
    if np.array_equal(readings[0].qpos, readings[1].qpos):
        return readings[0]
    if readings[0].bodies is None:
        count = recorded.bodies.pos.shape[1] if recorded.bodies else 0
        raise MotionFileError(
            f"it has {count} bodies, which do not tell the order of its "
            f"{recorded.joints.shape[1]} joints; give --joint-order mujoco (mjlab) or isaac "
            "(BeyondMimic)"
        )
    thin = thinned(recorded, _COMPARED_FRAMES)
    gaps = [_mean_gap(interpret(thin, r.conventions, robot.spec), robot) for r in readings]
    first, second = np.argsort(gaps)[:2]
    found = readings[0].bodies.names is not None or gaps[first] < FOUND_M
    if gaps[first] > 0.5 * gaps[second] or not found:
        raise ImplausibleError(
            f"its body positions fit neither joint order (they are off by {gaps[first]:.3f} m on "
            f"average in the order of {ORDERS[first]}, {gaps[second]:.3f} m in that "
            f"of {ORDERS[second]}); give --joint-order"
        )
    return readings[first]


def _mean_gap(raw: RawMotion, robot: Robot) -> float:
    return kinematics_gap(raw.qpos, raw.bodies, robot).mean_m if raw.bodies else np.inf
