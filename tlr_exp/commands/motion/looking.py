"""tlr-motion info and list: what a clip holds and asks of a robot, which motions there are."""

import argparse
import shutil
import textwrap

import mujoco
import numpy as np
import yaml

from tlr_exp.commands.motion.files import CLIP_HELP, load_clip, size
from tlr_exp.config.input_files import motion_content
from tlr_exp.motion.checks import ROOT_QUAT
from tlr_exp.motion.clip import MotionClip, kinematics_error
from tlr_exp.motion.clips import motion_names
from tlr_exp.motion.dynamics import inverse_dynamics
from tlr_exp.motion.quaternions import angle_between
from tlr_exp.robot.model import Robot, build_robot

_NAME_WIDTH, _LEAST_TEXT_WIDTH = 12, 40


def add_info(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("clip", metavar="CLIP", help=CLIP_HELP)
    parser.set_defaults(run=_info)


def add_list(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(run=_list)


def _info(clip: str) -> None:
    robot = build_robot()
    loaded = load_clip(clip, robot)
    print(f"{clip}: {size(loaded)}")
    for line in (*_measures(loaded, robot), *_demands(loaded, robot)):
        print(f"  {line}")


def _measures(clip: MotionClip, robot: Robot) -> list[str]:
    root = clip.qpos[:, :3]
    travel = float(np.linalg.norm(np.diff(root[:, :2], axis=0), axis=1).sum())
    turn = angle_between(clip.qpos[:1, ROOT_QUAT], clip.qpos[:, ROOT_QUAT]).max()
    speed = np.abs(clip.qvel[:, 6:]) / robot.velocity_limit_rad_s
    fastest = robot.spec.joint_names[int(speed.max(axis=0).argmax())]
    position, angle = kinematics_error(clip, robot)
    return [
        f"pelvis: height {root[:, 2].min():.3f} to {root[:, 2].max():.3f} m, path {travel:.2f} m, "
        f"turned from the start by at most {np.degrees(turn):.0f} degrees",
        f"lowest body origin: {clip.body_pos_w[..., 2].min():.3f} m",
        f"fastest joint: {fastest}, {100 * speed.max():.0f} % of its speed limit",
        f"forward kinematics: bodies differ by at most {position * 1000:.3f} mm and "
        f"{np.degrees(angle):.3f} degrees",
    ]


def _demands(clip: MotionClip, robot: Robot) -> list[str]:
    """What the motion asks of motors and floor, by inverse dynamics."""
    effort = inverse_dynamics(clip, robot)
    share = np.abs(effort.joint_torque) / robot.effort_limit_nm
    frame, joint = np.unravel_index(share.argmax(), share.shape)
    left, right = effort.foot_force.max(axis=0)
    weight = mujoco.mj_getTotalmass(robot.model) * np.linalg.norm(robot.model.opt.gravity)
    hardest = int(effort.unmet_force.argmax())
    return [
        f"largest torque: {robot.spec.joint_names[joint]} at {frame / clip.fps:.2f} s, "
        f"{100 * share.max():.0f} % of its limit (better below 60 %)",
        f"floor on a foot: up to {left:.0f} N left, {right:.0f} N right; the robot weighs "
        f"{weight:.0f} N",
        f"force that no floor can give: at most {effort.unmet_force[hardest]:.1f} N, at "
        f"{hardest / clip.fps:.2f} s (a feasible motion needs next to none)",
    ]


def _list() -> None:
    indent = " " * (_NAME_WIDTH + len(" 0.0 s  "))
    width = max(shutil.get_terminal_size().columns, len(indent) + _LEAST_TEXT_WIDTH)
    for name in motion_names():
        script = yaml.safe_load(motion_content(name))
        seconds = script["keyframes"][-1]["time_s"]
        text = f"{name:{_NAME_WIDTH}} {seconds:3.1f} s  {' '.join(script['description'].split())}"
        print(textwrap.fill(text, width, subsequent_indent=indent))
