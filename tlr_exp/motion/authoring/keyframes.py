"""From a keyframe file to a clip: curves, balance, inverse kinematics; and a cache of the result.

docs/keyframes.md describes the files.
"""

import hashlib
from contextlib import suppress
from dataclasses import replace
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from threadpoolctl import threadpool_limits

from tlr_exp.errors import UserError
from tlr_exp.machine import variables
from tlr_exp.motion.authoring.balance import (
    GRAVITY,
    SLOW_SPEED_M_S,
    MassEstimate,
    check_balance,
    load_of,
    plan_com,
)
from tlr_exp.motion.authoring.plan import MotionPlan
from tlr_exp.motion.authoring.script import KeyframeError, read_script
from tlr_exp.motion.clip import MotionClip, check_consistency, clip_from_qpos
from tlr_exp.motion.clips import motion_names
from tlr_exp.motion.dynamics import centroidal
from tlr_exp.motion.feet import sole_points
from tlr_exp.robot.model import Robot

if TYPE_CHECKING:
    from tlr_exp.motion.authoring.ik import BodySolver

# The first pass takes the robot for a point mass below its pelvis; each further one knows from the
# clip before where the mass is, what swinging limbs add, and where the motion is slow.
_PASSES = 4
_FLIGHT_PASSES = 9  # with flights, whose momentum each pass brings nearer to a constant
# Light feet need a long lever. Motions without flight keep at least their weight in it.
_LEAST_LOAD_IN_FLIGHT = 0.3


def load_motion(name_or_path: str | Path, robot: Robot) -> MotionClip:
    """A motion by the name of an authored one, or from a ``.yaml`` or ``.npz`` file.

    Authored motions are built in seconds the first time and then read from the user's cache
    (``$XDG_CACHE_HOME/tlr_exp``, or ``~/.cache/tlr_exp``).

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: there is no such name (the message lists the names), or the file is refused.
    """
    path = Path(name_or_path)
    if path.suffix == ".npz":
        clip = MotionClip.load(path, robot.spec)
        check_consistency(clip, robot, str(path))
        return clip
    if path.suffix in (".yaml", ".yml"):
        if not path.is_file():
            raise FileNotFoundError(f"there is no keyframe file {path}")
        text = path.read_text(encoding="utf-8")
    else:
        text = _authored(str(name_or_path))
    try:
        return _cached_clip(text, robot)
    except KeyframeError as error:
        raise KeyframeError(f"{name_or_path}: {error}") from error


# The threads of a linear-algebra library add in another order than one does: one thread makes the
# same bits wherever a motion is built.
@threadpool_limits.wrap(limits=1)
def build_clip(text: str, robot: Robot) -> MotionClip:
    """Turn the text of a keyframe file into a clip; the same bits at any number of threads.

    Args:
        text: YAML.
        robot: gives the model.

    Raises:
        KeyframeError: the text is not understood, or the motion cannot be performed.
    """
    # Only here: the inverse kinematics takes long to import, and a cached clip needs none.
    from tlr_exp.motion.authoring.ik import BodySolver, HandSolver

    script = read_script(text, robot.spec, HandSolver(robot))
    plan, solver = MotionPlan(script, robot), BodySolver(robot)
    mass = _point_mass(plan, robot.spec.stance.com_below_pelvis_m)
    for number in range((_FLIGHT_PASSES if plan.flights else _PASSES) - 1):
        clip = _one_pass(plan, mass, solver, robot, strict=False)
        measured = _measure(clip, plan, robot)
        # What is slow depends on the plan for what is slow: late passes must not flip it for ever.
        mass = measured if number < _PASSES else replace(measured, slow=mass.slow)
        plan.keep_momentum(clip, robot)
    return _one_pass(plan, mass, solver, robot, strict=True)


def _one_pass(
    plan: MotionPlan, mass: MassEstimate, solver: "BodySolver", robot: Robot, strict: bool
) -> MotionClip:
    try:
        mass = plan.fall_freely(mass)
        support = plan.support(mass.pelvis_offset)
        com = plan_com(support, mass, plan.times_s)
        if strict:
            check_balance(com, support, mass, plan.times_s)
        qpos = solver.solve(plan.targets(com, mass.pelvis_offset), strict)
        return clip_from_qpos(qpos, plan.fps, robot)
    except ValueError as error:
        raise KeyframeError(f"the motion cannot be performed: {error}") from error


def _point_mass(plan: MotionPlan, below_pelvis_m: float) -> MassEstimate:
    frames = len(plan.times_s)
    height = plan.pelvis_height_m - below_pelvis_m
    return MassEstimate(
        height=height,
        load=load_of(height, plan.times_s),
        zmp_offset=np.zeros((frames, 2)),
        pelvis_offset=np.tile([0.0, 0.0, below_pelvis_m], (frames, 1)),
        slow=np.zeros(frames, dtype=bool),
    )


def _measure(clip: MotionClip, plan: MotionPlan, robot: Robot) -> MassEstimate:
    """What a clip shows of the mass, for the next plan."""
    motion = centroidal(clip, robot)
    lift = np.gradient(motion.com_vel[:, 2:], 1 / clip.fps, axis=0)
    spin = np.gradient(motion.angular_momentum, 1 / clip.fps, axis=0)
    least = _LEAST_LOAD_IN_FLIGHT if plan.flights else 1.0
    weight = motion.mass * np.maximum(lift + GRAVITY, least * GRAVITY)
    # A little faster than slow, because the next plan's speed differs a little.
    slow = np.linalg.norm(motion.com_vel[:, :2], axis=1) < 1.05 * SLOW_SPEED_M_S
    return MassEstimate(
        height=motion.com[:, 2],
        load=load_of(motion.com[:, 2], plan.times_s),
        zmp_offset=np.stack([-spin[:, 1], spin[:, 0]], axis=1) / weight,
        pelvis_offset=clip.qpos[:, :3] - motion.com,
        slow=slow,
    )


def _authored(name: str) -> str:
    if name not in motion_names():
        raise UserError(
            f"there is no motion {name!r}; the motions are {', '.join(motion_names())}; "
            "a path must end in .yaml or .npz"
        )
    return files("tlr_exp.motion.clips").joinpath(f"{name}.yaml").read_text(encoding="utf-8")


def _cached_clip(text: str, robot: Robot) -> MotionClip:
    folder = variables.cache_folder()
    if folder is None:
        return build_clip(text, robot)
    path = folder / f"{_content_hash(text, robot)}.npz"
    try:
        return MotionClip.load(path, robot.spec)
    except (OSError, ValueError):
        clip = build_clip(text, robot)
    # The cache saves seconds; a motion is not worth failing for want of one.
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        clip.save(path)
    return clip


def _content_hash(text: str, robot: Robot) -> str:
    """A hash of all that a clip depends on: the script, the kinematics and masses, the code."""
    digest = hashlib.sha256(text.encode())
    model = robot.model
    for array in (
        *(model.body_parentid, model.body_pos, model.body_quat, model.body_mass),
        *(model.body_ipos, model.body_iquat, model.body_inertia),
        *(model.jnt_pos, model.jnt_axis, model.jnt_range, robot.body_ids),
        *(sole_points(robot, side) for side in range(2)),
        np.array(robot.spec.stance.joint_pos_rad),
    ):
        digest.update(np.ascontiguousarray(array).tobytes())
    for room in ("tlr_exp.motion", "tlr_exp.motion.authoring"):
        for source in sorted(files(room).iterdir(), key=lambda entry: entry.name):
            if source.name.endswith(".py"):
                digest.update(source.read_bytes())
    for package in ("mujoco", "mink", "daqp", "scipy", "numpy"):
        digest.update(version(package).encode())
    return digest.hexdigest()[:32]
