"""The soles of a model: where a foot touches the floor, and what area the touching feet span."""

import mujoco
import numpy as np
from scipy.spatial import ConvexHull

from tlr_exp.errors import UserError
from tlr_exp.robot.model import Robot

_TOUCHING = 1e-4  # m; points this close to the lowest count as the sole


def foot_geoms(robot: Robot, side: int) -> list[int]:
    """Geoms by which a foot (0 left, 1 right) can touch the floor.

    Raises:
        ValueError: the foot has none.
    """
    model = robot.model
    foot = int(robot.foot_body_ids[side])
    mine = [g for g in range(model.ngeom) if model.geom_bodyid[g] == foot]
    pairs = zip(model.pair_geom1, model.pair_geom2, strict=True)
    planes = {g for g in range(model.ngeom) if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_PLANE}
    paired = {g for pair in pairs for g in pair if planes & set(pair)}
    geoms = [g for g in mine if g in paired]
    geoms = geoms or [g for g in mine if model.geom_contype[g] or model.geom_conaffinity[g]]
    if not geoms:
        raise UserError(f"no geom of {robot.spec.foot_names[side]} can touch the floor")
    return geoms


def foot_extremes(robot: Robot, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Spheres whose hull is the foot (0 left, 1 right), in the frame of the ankle roll link.

    Returns:
        Centres [n, 3] and radii [n], in metres (radius 0 for the corners of a box).

    Raises:
        ValueError: the foot has no geom that can touch the floor, or one of an unknown type.
    """
    model, centres, radii = robot.model, [], []
    for geom in foot_geoms(robot, side):
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        offsets, radius = _extremes(model.geom_type[geom], model.geom_size[geom])
        centres.append(model.geom_pos[geom] + offsets @ rotation.reshape(3, 3).T)
        radii.append(np.full(len(offsets), radius))
    return np.concatenate(centres), np.concatenate(radii)


def sole_points(robot: Robot, side: int) -> np.ndarray:
    """Points [n, 3] of a foot (0 left, 1 right) that touch the floor when it stands flat.

    In the frame of the ankle roll link.

    Raises:
        ValueError: as ``foot_extremes``.
    """
    centres, radii = foot_extremes(robot, side)
    points = centres - np.outer(radii, [0.0, 0.0, 1.0])
    return points[points[:, 2] < points[:, 2].min() + _TOUCHING]


def _extremes(kind: int, size: np.ndarray) -> tuple[np.ndarray, float]:
    """Corners [n, 3] of a geom in its own frame, and the radius around them."""
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.zeros((1, 3)), size[0]
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return np.array([[0.0, 0.0, size[1]], [0.0, 0.0, -size[1]]]), size[0]
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
        return signs * size, 0.0
    name = mujoco.mjtGeom(kind).name
    raise UserError(f"a foot with a geom of type {name}; spheres, capsules and boxes are known")


def half_planes(points: np.ndarray) -> np.ndarray:
    """The convex hull of points [n, 2] as rows (a, b, c) with a x + b y + c <= 0 inside.

    The normals (a, b) are unit vectors, so a row's value is a signed distance in metres.
    """
    return np.unique(ConvexHull(points).equations.round(12), axis=0)


def hip_offset(robot: Robot, side: int) -> np.ndarray:
    """From the pelvis's origin to the axis of the hip's roll, [3] in the pelvis's frame."""
    model, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[:] = 0.0
    data.qpos[3] = 1.0
    mujoco.mj_kinematics(model, data)
    return data.body(robot.spec.hip_names[side]).xpos - data.xpos[robot.pelvis_id]
