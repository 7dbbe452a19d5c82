"""A policy as one ONNX file: the network, its reference, and all that a controller must know.

Inputs   observation [n, D] float32, as the environment gives it, not normalised
         frame [n] int64, the frame of the reference that the observation shows
Outputs  action [n, 23], raw; joint_target [n, 23] rad, for the position control of the joints
         reference_qpos [n, 30] … : the reference at ``frame``, a field of ReferenceFrame each

The metadata is in ``metadata_of``, each value as JSON. docs/deploy.md has a controller that uses
nothing else.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import nn
from torchrl.modules import MLP

from tlr_exp.assembly.world import build_clip, build_robot_of
from tlr_exp.config.settings import RobotSettings
from tlr_exp.errors import UserError
from tlr_exp.evaluation.choosing import Choice, load_policy
from tlr_exp.export.observation_layout import observation_layout
from tlr_exp.motion.clip import MotionClip
from tlr_exp.motion.reference import ReferenceFrame
from tlr_exp.ppo.networks import RunningNorm, in_float32
from tlr_exp.records.outputs import check_free
from tlr_exp.records.places import plain_text
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.storage import atomic_write
from tlr_exp.robot.model import Robot, robot_xml
from tlr_exp.robot.timing import CONTROL_DT_S, DECIMATION

OPSET, IR_VERSION = 17, 8  # of 2022: what a robot's computer runs is rarely new
TOLERANCE = 1e-4
CHECKED_STATES = 1000
_ACTIVATIONS = {nn.ELU: "Elu", nn.ReLU: "Relu", nn.Tanh: "Tanh"}


def write_onnx(choice: Choice, output: Path, force: bool) -> float:
    """Write the chosen policy; returns the largest difference from PyTorch that was found.

    Raises:
        ValueError: the file would not say what the policy does; or as ``load_policy``.
        FileExistsError: ``output`` exists, and ``force`` is not given.
        StorageError: the file cannot be written.
    """
    check_free([output], force)
    robot = build_robot_of(choice.settings.env)
    clip = build_clip(choice.settings.env, robot)
    actor = load_policy(choice).cpu()
    model = onnx_model(choice, actor, robot, clip)
    difference = largest_difference(model, actor)
    if not difference <= TOLERANCE:
        raise UserError(
            f"{output.name} was not written: its actions differ from those of PyTorch by "
            f"{difference:.1e}, more than {TOLERANCE:g}"
        )
    atomic_write(output, model.SerializeToString())
    return difference


def onnx_model(choice: Choice, actor: nn.Module, robot: Robot, clip: MotionClip) -> onnx.ModelProto:
    """The graph with its metadata, checked for its form.

    Raises:
        ValueError: the actor has layers of a kind that is not known here.
    """
    nodes = _Nodes()
    _add_network(nodes, actor)
    _add_reference(nodes, clip)
    _add_joint_target(nodes, choice.settings.env.action, robot, clip)
    graph = helper.make_graph(
        nodes.nodes,
        "tracking_policy",
        inputs=[
            _value("observation", TensorProto.FLOAT, observation_dim(actor)),
            _value("frame", TensorProto.INT64),
        ],
        outputs=[
            _value("action", TensorProto.FLOAT, robot.spec.num_joints),
            _value("joint_target", TensorProto.FLOAT, robot.spec.num_joints),
            *(
                _value(f"reference_{name}", TensorProto.FLOAT, *getattr(clip, name).shape[1:])
                for name in ReferenceFrame._fields
            ),
        ],
        initializer=nodes.constants,
    )
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION
    )
    metadata = metadata_of(choice, robot, clip)
    helper.set_model_props(model, {name: json.dumps(value) for name, value in metadata.items()})
    onnx.checker.check_model(model)
    return model


def metadata_of(choice: Choice, robot: Robot, clip: MotionClip) -> dict[str, Any]:
    """What a controller must know besides the graph; SI units, joints in the order of the names."""
    env = choice.settings.env
    manifest = RunDirectory.open(choice.run).manifest
    origin = manifest.get("policy") or {"run_id": manifest["run_id"]}
    return {
        "joint_names": list(robot.spec.joint_names),
        "kp": robot.kp.tolist(),
        "kd": robot.kd.tolist(),
        "effort_limit_nm": robot.effort_limit_nm.tolist(),
        "default_joint_pos_rad": robot.default_joint_pos_rad.tolist(),
        "action_scale_rad": robot.action_scale_rad.tolist(),
        "action_is_relative_to": env.action,
        "control_dt_s": CONTROL_DT_S,
        "physics_steps": DECIMATION,
        "observation": env.observation,
        "observation_layout": observation_layout(env.observation, robot.spec),
        "tracked_bodies": list(robot.spec.tracked_bodies),
        "reference": {
            "motion": plain_text(choice.motion),
            "num_frames": clip.num_frames,
            "fps": clip.fps,
            "lead": env.reference_lead,
            "phase": "frame / (num_frames - 1)",
        },
        "robot_mjcf": _model_of(env.robot, robot),
        "run": {
            "name": choice.run.name,
            "iteration": choice.iteration,
            "identity": manifest.get("identity", ""),
            "git_commit": (manifest.get("git") or {}).get("commit", ""),
            **origin,
        },
    }


def _model_of(settings: RobotSettings, robot: Robot) -> str:
    """The robot as one text; empty for a model of one's own, which names files elsewhere."""
    return "" if settings.mjcf else robot_xml(robot.spec, settings.gains, settings.collisions)


class _Nodes:
    """The nodes and constants of a graph in the making."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def constant(self, name: str, value: Any, dtype: type = np.float32) -> str:
        array = np.ascontiguousarray(np.asarray(value, dtype=dtype))
        self.constants.append(numpy_helper.from_array(array, name))
        return name

    def add(self, kind: str, inputs: list[str], output: str, **attributes: Any) -> str:
        self.nodes.append(helper.make_node(kind, inputs, [output], name=output, **attributes))
        return output


def _value(name: str, kind: int, *shape: int) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, kind, ["n", *shape])


def observation_dim(actor: nn.Module) -> int:
    return next(layer.in_features for layer in actor.modules() if isinstance(layer, nn.Linear))


def _add_network(nodes: _Nodes, actor: nn.Module) -> None:
    value = "observation"
    norms = [module for module in actor.modules() if isinstance(module, RunningNorm)]
    for norm in norms:
        value = nodes.add("Sub", [value, nodes.constant("shift", norm.shift)], "shifted")
        value = nodes.add("Mul", [value, nodes.constant("scale", norm.scale)], "scaled")
        limits = [nodes.constant("low", -norm.clip), nodes.constant("high", norm.clip)]
        value = nodes.add("Clip", [value, *limits], "normalised")
    layers = list(next(module for module in actor.modules() if isinstance(module, MLP)))
    for number, layer in enumerate(layers):
        output = "action" if number == len(layers) - 1 else f"layer_{number}"
        if isinstance(layer, nn.Linear):
            weights = [
                nodes.constant(f"{kind}_{number}", tensor.detach())
                for kind, tensor in (("weight", layer.weight), ("bias", layer.bias))
            ]
            value = nodes.add("Gemm", [value, *weights], output, transB=1)
        elif type(layer) in _ACTIVATIONS:
            value = nodes.add(_ACTIVATIONS[type(layer)], [value], output)
        else:
            raise UserError(f"the actor has a layer {layer}, which this export does not know")


def _add_reference(nodes: _Nodes, clip: MotionClip) -> None:
    first, last = (
        nodes.constant("first", 0, np.int64),
        nodes.constant("last", clip.num_frames - 1, np.int64),
    )
    shown = nodes.add("Clip", ["frame", first, last], "shown_frame")
    after = nodes.add("Add", ["frame", nodes.constant("one", 1, np.int64)], "frame_after")
    nodes.add("Clip", [after, first, last], "coming_frame")
    for name in ReferenceFrame._fields:
        frames = nodes.constant(f"clip_{name}", getattr(clip, name))
        nodes.add("Gather", [frames, shown], f"reference_{name}", axis=0)


def _add_joint_target(nodes: _Nodes, action: str, robot: Robot, clip: MotionClip) -> None:
    """What ``TrackingEnv`` makes of an action: see the choices of ``env.action``."""
    scale = nodes.constant("action_scale", robot.action_scale_rad)
    offset = nodes.add("Mul", ["action", scale], "joint_offset")
    if action == "default_pose":
        origin = nodes.constant("default_joint_pos", robot.default_joint_pos_rad)
    elif action == "current_pose":
        raise UserError(
            "env.action=current_pose cannot be exported: its targets follow the robot's own joints"
        )
    else:
        positions = clip.qpos[:, 7:]
        if action == "reference_motion":
            positions = positions + (robot.kd / robot.kp) * clip.qvel[:, 6:]
        targets = nodes.constant("clip_joint_target", positions)
        origin = nodes.add("Gather", [targets, "coming_frame"], "joint_origin", axis=0)
    nodes.add("Add", [origin, offset], "joint_target")


@torch.no_grad()
def largest_difference(model: onnx.ModelProto, actor: Any, states: int = CHECKED_STATES) -> float:
    """Largest difference of an action from PyTorch's, over states drawn about the ones seen."""
    dim = observation_dim(actor)
    observation = torch.randn(states, dim, generator=torch.Generator().manual_seed(0))
    for norm in (module for module in actor.modules() if isinstance(module, RunningNorm)):
        observation = observation / norm.scale + norm.shift
    with in_float32(actor):
        expected, _ = actor.module[0].module(observation)
    session = onnxruntime.InferenceSession(
        model.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    inputs = {"observation": observation.numpy(), "frame": np.zeros(states, np.int64)}
    (found,) = session.run(["action"], inputs)
    return float(np.abs(np.asarray(found) - expected.numpy()).max())
