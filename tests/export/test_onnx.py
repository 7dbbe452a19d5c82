"""A policy as an ONNX file: the targets of the training, and a controller that needs no more."""

import dataclasses
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from learners import build_training
from torchrl.envs.utils import ExplorationType, set_exploration_type, step_mdp

from tlr_exp import keys
from tlr_exp.assembly.environment import build_evaluation_env
from tlr_exp.assembly.terms import terms_of_evaluation
from tlr_exp.assembly.world import build_clip, build_robot_of
from tlr_exp.commands import export_policy
from tlr_exp.env.observations import observation_dims
from tlr_exp.evaluation.choosing import choose, load_policy
from tlr_exp.evaluation.policies import evaluate
from tlr_exp.export.observation_layout import observation_layout
from tlr_exp.export.onnx_file import largest_difference, onnx_model, write_onnx
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.robot.g1 import G1
from tlr_exp.robot.model import build_robot, robot_xml

ROOT = Path(__file__).parents[2]
POLICY = ROOT / "results" / "policies" / "gym_motion-fixed"


@pytest.fixture(scope="module")
def run_of(settings_of, tmp_path_factory):
    """``run_of(*overrides)``: a run of one iteration, so that its normalisation holds something."""

    def train(*overrides: str) -> Path:
        tiny = ("scale.num_envs=16", "scale.iterations=1", "ppo.num_steps=4", *overrides)
        threads = ("num_threads=1", "physics.num_threads=1")
        settings = settings_of(*tiny, *threads, "ppo.hidden_sizes=[16,8]")
        run = RunDirectory.create(
            tmp_path_factory.mktemp("runs") / "run", dataclasses.asdict(settings), {}
        )
        build_training(settings, run).train()
        return run.path

    return train


@pytest.mark.parametrize(
    "overrides",
    [
        ("env.action=default_pose", "env.observation=history"),
        ("env.action=reference_pose", "env.observation=reference", "ppo.activation=relu"),
        ("env.action=reference_motion", "env.reference_lead=0", "ppo.activation=tanh"),
        ("env.action=reference_pose", "ppo.normalize_observations=false"),
    ],
    ids=lambda overrides: overrides[0],
)
def test_targets_and_reference_are_those_of_the_environment(run_of, overrides):
    choice = choose(run_of(*overrides))
    robot = build_robot_of(choice.settings.env)
    clip = build_clip(choice.settings.env, robot)
    actor = load_policy(choice)
    env = build_evaluation_env(
        choice.settings, robot, clip, terms_of_evaluation(choice.settings), starts=3
    )
    model = onnx_model(choice, actor, robot, clip)
    session = onnxruntime.InferenceSession(
        model.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    names = ["action", "joint_target", "reference_qpos", "reference_body_lin_vel_w"]
    with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
        now = env.reset()
        for _ in range(8):
            acting = actor(now)
            frame = env._frame_index()
            inputs = {"observation": now[keys.OBSERVATION].numpy(), "frame": frame.numpy()}
            action, target, qpos, lin_vel = session.run(names, inputs)
            np.testing.assert_allclose(action, acting[keys.ACTION], atol=1e-5)
            coming, joints = env.reference.frame(frame + 1), env.state.qpos[:, 7:]
            expected = env.joint_targets(acting[keys.ACTION], joints, coming)
            np.testing.assert_allclose(target, expected, atol=1e-5)
            reference = env.reference.frame(frame)
            np.testing.assert_allclose(qpos, reference.qpos, atol=1e-6)
            np.testing.assert_allclose(lin_vel, reference.body_lin_vel_w, atol=1e-6)
            now = step_mdp(env.step(acting))


def test_a_frame_behind_the_end_takes_the_last_one(run_of):
    choice = choose(run_of("env.action=reference_pose"))
    robot = build_robot_of(choice.settings.env)
    clip = build_clip(choice.settings.env, robot)
    model = onnx_model(choice, load_policy(choice), robot, clip)
    session = onnxruntime.InferenceSession(
        model.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    zeros = np.zeros((2, observation_dims(G1)["history"]), np.float32)
    inputs = {"observation": zeros, "frame": np.array([clip.num_frames - 1, clip.num_frames + 7])}
    for rows in session.run(["joint_target", "reference_qpos"], inputs):
        np.testing.assert_array_equal(rows[0], rows[1])


def test_the_controller_of_the_docs_does_what_an_evaluation_does(tmp_path):
    """Four hundred steps of closed loop, by a program that knows nothing of this project."""
    text = (ROOT / "docs" / "deploy.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert "tlr_exp" not in program
    assert len(program.splitlines()) <= 65
    (tmp_path / "controller.py").write_text(program)
    write_onnx(choose(POLICY), tmp_path / "policy.onnx", force=False)
    ended = subprocess.run(
        [sys.executable, "controller.py", "policy.onnx"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    mean, largest = map(float, re.findall(r"([\d.]+) m\b", ended.stdout))
    trajectory = evaluate(choose(POLICY)).trajectory
    distance = np.linalg.norm(trajectory.body_pos_w - trajectory.reference_body_pos_w, axis=-1)
    assert mean == pytest.approx(distance.mean(), abs=1e-3)
    assert largest == pytest.approx(distance.max(), abs=5e-3)


def test_what_a_controller_must_know(run_of, tmp_path):
    run = run_of("env.action=reference_pose", "env.observation=reference")
    assert export_policy.main([str(run), "-o", str(tmp_path / "policy.onnx")]) == 0
    model = onnx.load(tmp_path / "policy.onnx")
    meta = {entry.key: json.loads(entry.value) for entry in model.metadata_props}
    robot = build_robot()
    assert meta["joint_names"] == list(G1.joint_names)
    np.testing.assert_allclose(meta["kp"], robot.kp)
    np.testing.assert_allclose(meta["action_scale_rad"], robot.action_scale_rad)
    assert meta["action_is_relative_to"] == "reference_pose"
    assert meta["control_dt_s"] == 0.02
    assert meta["reference"]["lead"] == 1
    assert meta["run"]["iteration"] == 1
    assert str(tmp_path) not in json.dumps(meta)
    assert str(run) not in json.dumps(meta)


@pytest.mark.parametrize("observation", list(observation_dims(G1)))
def test_the_layout_has_every_number_of_an_observation(observation):
    parts = observation_layout(observation, G1)
    assert (
        sum(part["width"] * part["frames"] for part in parts) == observation_dims(G1)[observation]
    )


def test_a_network_that_differs_is_found(run_of):
    choice = choose(run_of("env.action=reference_pose"))
    robot = build_robot_of(choice.settings.env)
    actor = load_policy(choice)
    model = onnx_model(choice, actor, robot, build_clip(choice.settings.env, robot))
    assert largest_difference(model, actor) < 1e-5
    with torch.no_grad():
        list(actor.parameters())[-2].add_(0.01)
    assert largest_difference(model, actor) > 1e-4


def test_what_cannot_be_exported_is_refused_and_nothing_replaced(run_of, tmp_path, capsys):
    run = run_of("env.action=current_pose")
    output = tmp_path / "policy.onnx"
    assert export_policy.main([str(run), "-o", str(output)]) == 2
    assert "current_pose cannot be exported" in capsys.readouterr().err
    assert not output.exists()
    output.write_bytes(b"mine")
    assert export_policy.main([str(run), "-o", str(output)]) == 2
    assert output.read_bytes() == b"mine"
    assert export_policy.main([str(run), "-o", str(tmp_path / "policy.pb")]) == 2
    assert "one that ends in .onnx" in capsys.readouterr().err


@pytest.mark.parametrize("collisions", ["full", "feet"])
def test_the_model_as_text_is_the_model(collisions):
    import mujoco

    written = mujoco.MjModel.from_xml_string(robot_xml(G1, "asap", collisions))
    built = build_robot(gains="asap", collisions=collisions).model
    assert written.npair == built.npair
    assert written.opt.timestep == built.opt.timestep
    for name in ("body_mass", "dof_armature", "actuator_gainprm", "jnt_range", "pair_friction"):
        np.testing.assert_allclose(getattr(written, name), getattr(built, name), err_msg=name)
