"""The robot and the floor in every frame of a clip: heights, free flight, feet in contact."""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.ndimage import grey_opening

from tlr_exp.errors import UserError
from tlr_exp.motion.clip import MotionClip
from tlr_exp.motion.feet import foot_extremes
from tlr_exp.motion.quaternions import rotate
from tlr_exp.robot.model import Robot

CONTACT_M = 0.005  # a point this close to what carries the robot touches it too
# Free fall: over this time the centre of mass accelerates by -g, give or take this share of g.
FALL_WINDOW_S, FALL_TOLERANCE = 0.14, 0.4
# What is lifted for less than this is a step or a hop; for longer, the clip has its floor there.
GROUND_S = 1.0
# Around touch-down and take-off a foot moves while it is still, or already, close to the floor.
EDGE_S = 0.06


@dataclass(frozen=True, eq=False)
class FloorContacts:
    """Heights over the floor (z = 0) in metres, one column a frame.

    Attributes:
        lowest: [T], the lowest point of the robot; negative in the floor.
        lowest_body: [T], the model's body that it belongs to.
        flight: [T] bool, nothing touches and the centre of mass falls freely.
        level: [T], the height of what carries the robot; NaN in flight. Whatever does not fall
            freely is carried, and the lowest point is what carries it.
        ground: [T], the floor as the clip has it: ``level`` without what rises above it for less
            than ``GROUND_S``. It is 0 in a good clip.
        foot: [2, T], the lowest point of the left and right foot.
        contact: [2, T] bool, the foot is on or in the floor or the clip's own ``ground``.
        foot_speed: [2, T], m/s, horizontal speed of the material points of the sole that touch,
            their mean.
        self_depth: [T], how deep two links are in each other, 0 where they are not.
        self_bodies: [T, 2], the bodies of these links.
    """

    lowest: np.ndarray
    lowest_body: np.ndarray
    flight: np.ndarray
    level: np.ndarray
    ground: np.ndarray
    foot: np.ndarray
    contact: np.ndarray
    foot_speed: np.ndarray
    self_depth: np.ndarray
    self_bodies: np.ndarray


def floor_contacts(clip: MotionClip, robot: Robot) -> FloorContacts:
    """Measure a clip against the floor, by the collision shapes of the model.

    Raises:
        ValueError: the model has no shape, or one of an unknown kind, that can touch the floor.
    """
    geoms = floor_geoms(robot.model)
    heights, com_z, depth, bodies = _sweep(clip, robot, geoms)
    column = heights.argmin(axis=1)
    lowest = heights.min(axis=1)
    flight = free_fall(com_z, lowest > CONTACT_M, clip.fps, -robot.model.opt.gravity[2])
    level = np.where(flight, np.nan, lowest)
    foot, speed = zip(*(_sole(clip, robot, side) for side in range(2)), strict=True)
    ground = clip_ground(level, clip.fps)
    contact = np.array(foot) <= np.maximum(ground, 0.0) + CONTACT_M
    return FloorContacts(
        lowest=lowest,
        lowest_body=robot.model.geom_bodyid[geoms[column]],
        flight=flight,
        level=level,
        ground=ground,
        foot=np.array(foot),
        contact=contact & ~flight,
        foot_speed=np.array(speed),
        self_depth=depth,
        self_bodies=bodies,
    )


def clip_ground(level: np.ndarray, fps: float) -> np.ndarray:
    """The floor that a clip has in mind, [T]: a morphological opening of ``level`` [T].

    It cuts off what rises for less than ``GROUND_S`` and keeps slopes; flight (NaN) is bridged.
    """
    known = np.flatnonzero(~np.isnan(level))
    if not len(known):
        return np.zeros(len(level))
    filled = np.interp(np.arange(len(level)), known, level[known])
    half = round(GROUND_S * fps / 2)
    # Beyond its ends the level goes on as it came, so that a slope is one up to the end.
    padded = np.pad(filled, 2 * half, mode="reflect", reflect_type="odd")
    opened = grey_opening(padded, size=2 * half + 1)
    return opened[2 * half : len(opened) - 2 * half]


def floor_geoms(model: mujoco.MjModel) -> np.ndarray:
    """The robot's geoms that can touch the floor: by explicit pairs, or by contact bits.

    Raises:
        ValueError: there is none, or one whose lowest point is not known.
    """
    plane = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)
    pairs = np.stack([model.pair_geom1, model.pair_geom2], axis=1)
    paired = set(pairs[np.isin(pairs, plane).any(axis=1)].ravel().tolist())
    bits = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    found = [g for g in np.flatnonzero(model.geom_bodyid > 0) if g in paired or bits[g]]
    if not found:
        raise UserError("no geom of the robot can touch the floor")
    unknown = {int(model.geom_type[g]) for g in found} - set(_SUPPORT)
    if unknown:
        names = ", ".join(mujoco.mjtGeom(kind).name for kind in sorted(unknown))
        raise UserError(f"geoms of type {names} against the floor are not supported")
    return np.array(found)


def free_fall(com_z: np.ndarray, free: np.ndarray, fps: float, gravity: float) -> np.ndarray:
    """Frames in which the robot falls freely, [T] bool.

    Args:
        com_z: [T], height of the centre of mass in metres.
        free: [T] bool, nothing touches the floor.
        fps: frames a second.
        gravity: m/s^2, positive.

    A frame falls freely if it lies in a window of contact-free frames, ``FALL_WINDOW_S`` long (or
    as long as the contact-free time is), over which the parabola of least squares through
    ``com_z`` has the acceleration -g.
    """
    falls = np.zeros(len(com_z), dtype=bool)
    window = max(4, round(FALL_WINDOW_S * fps) + 1)
    for start, end in stretches(free):
        if end - start < 3:  # a parabola needs three points; neighbours almost fall too
            low, high = max(0, start - 1), min(len(com_z), end + 1)
        else:
            low, high = start, end
        size = min(window, high - low)
        if size < 3:
            continue
        time = np.arange(size) / fps
        kernel = np.linalg.pinv(np.vander(time, 3))[0]
        acceleration = 2 * np.correlate(com_z[low:high] - com_z[low], kernel, mode="valid")
        for i in np.flatnonzero(np.abs(acceleration + gravity) < FALL_TOLERANCE * gravity):
            falls[low + i : low + i + size] = True
    return falls & free


def stretches(flags: np.ndarray) -> Iterator[tuple[int, int]]:
    """Runs of True in [T] bool, as (first, one past the last)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def steady_contact(contact: np.ndarray, fps: float) -> np.ndarray:
    """Contact [T] without ``EDGE_S`` at touch-down and take-off (the clip's own ends stay)."""
    margin, steady = round(EDGE_S * fps), np.zeros_like(contact)
    for start, end in stretches(contact):
        first = start if start == 0 else start + margin
        last = end if end == len(contact) else end - margin
        steady[first : max(first, last)] = True
    return steady


def _sweep(
    clip: MotionClip, robot: Robot, geoms: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Heights of ``geoms`` [T, n], of the centre of mass [T], self-contacts [T] and [T, 2]."""
    model, data, frames = robot.model, mujoco.MjData(robot.model), clip.num_frames
    position, up = np.empty((frames, len(geoms))), np.empty((frames, len(geoms), 3))
    com_z, depth, bodies = np.empty(frames), np.zeros(frames), np.zeros((frames, 2), dtype=int)
    root = robot.pelvis_id
    for t in range(frames):
        data.qpos[:] = clip.qpos[t]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        position[t], up[t] = data.geom_xpos[geoms, 2], data.geom_xmat[geoms, 6:]
        com_z[t] = data.subtree_com[root, 2]
        touching = model.geom_bodyid[data.contact.geom]
        within = np.where((touching > 0).all(axis=1), -data.contact.dist, 0.0)
        if within.size and within.max() > 0:
            depth[t], bodies[t] = within.max(), touching[within.argmax()]
    kinds, sizes = model.geom_type[geoms], model.geom_size[geoms]
    reach = [_SUPPORT[int(k)](up[:, i], sizes[i]) for i, k in enumerate(kinds)]
    return position - np.stack(reach, axis=1), com_z, depth, bodies


# How far a geom reaches below its centre, from the third row of its rotation [T, 3].
_SUPPORT = {
    int(mujoco.mjtGeom.mjGEOM_SPHERE): lambda up, size: np.full(len(up), size[0]),
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): lambda up, size: size[0] + size[1] * np.abs(up[:, 2]),
    int(mujoco.mjtGeom.mjGEOM_BOX): lambda up, size: np.abs(up) @ size,
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): lambda up, size: np.linalg.norm(up * size, axis=1),
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): lambda up, size: (
        size[0] * np.hypot(up[:, 0], up[:, 1]) + size[1] * np.abs(up[:, 2])
    ),
}


def _sole(clip: MotionClip, robot: Robot, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Height [T] of a foot's lowest point, and horizontal speed [T] of the points as low as it."""
    body = robot.spec.feet[side]
    centres, radii = foot_extremes(robot, side)
    arms = rotate(clip.body_quat_w[:, None, body], centres[None])
    arms[..., 2] -= radii
    heights = clip.body_pos_w[:, None, body, 2] + arms[..., 2]
    spin = clip.body_ang_vel_w[:, None, body]
    velocity = clip.body_lin_vel_w[:, None, body] + np.cross(spin, arms)
    speed = np.linalg.norm(velocity[..., :2], axis=-1)
    lowest = heights.min(axis=1)
    touching = heights <= lowest[:, None] + CONTACT_M
    return lowest, (speed * touching).sum(axis=1) / touching.sum(axis=1)
