"""tlr-motion info and list: what a clip holds, which motions there are."""

from __future__ import annotations

import argparse

import numpy as np

from tlr_exp.g1 import JOINT_NAMES
from tlr_exp.motion.checks import ROOT_QUAT
from tlr_exp.motion.clip import MotionClip, kinematics_error
from tlr_exp.motion.clips import motion_names
from tlr_exp.motion.quaternions import angle_between
from tlr_exp.motion_tool.files import CLIP_HELP, load_clip, size
from tlr_exp.robot import Robot, build_robot


def add_info(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("clip", metavar="CLIP", help=CLIP_HELP)
    parser.set_defaults(run=_info)


def add_list(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(run=_list)


def _info(options: argparse.Namespace) -> None:
    robot = build_robot()
    clip = load_clip(options.clip, robot)
    print(f"{options.clip}: {size(clip)}")
    for line in _measures(clip, robot):
        print(f"  {line}")


def _measures(clip: MotionClip, robot: Robot) -> list[str]:
    root = clip.qpos[:, :3]
    travel = float(np.linalg.norm(np.diff(root[:, :2], axis=0), axis=1).sum())
    turn = angle_between(clip.qpos[:1, ROOT_QUAT], clip.qpos[:, ROOT_QUAT]).max()
    speed = np.abs(clip.qvel[:, 6:]) / robot.velocity_limit_rad_s
    fastest = int(speed.max(axis=0).argmax())
    position, angle = kinematics_error(clip, robot)
    return [
        f"pelvis: height {root[:, 2].min():.3f} to {root[:, 2].max():.3f} m, path {travel:.2f} m, "
        f"turned from the start by at most {np.degrees(turn):.0f} degrees",
        f"lowest body origin: {clip.body_pos_w[..., 2].min():.3f} m",
        f"fastest joint: {JOINT_NAMES[fastest]}, {100 * speed.max():.0f} % of its speed limit",
        f"forward kinematics: bodies differ by at most {position * 1000:.3f} mm and "
        f"{np.degrees(angle):.3f} degrees",
    ]


def _list(options: argparse.Namespace) -> None:
    for name in motion_names():
        print(name)
