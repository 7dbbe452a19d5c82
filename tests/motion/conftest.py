"""Fixtures of the motion tests: one swaying clip, the authored motions built once."""

from collections.abc import Callable
from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from filelock import FileLock

from tlr_exp.motion.authoring.ik import HandSolver
from tlr_exp.motion.authoring.keyframes import build_clip
from tlr_exp.motion.authoring.plan import MotionPlan
from tlr_exp.motion.authoring.script import read_script
from tlr_exp.motion.clip import MotionClip, clip_from_qpos
from tlr_exp.robot.model import Robot


@pytest.fixture(scope="session")
def swaying_qpos(robot: Robot) -> np.ndarray:
    """[101, 30] at 50 Hz: every joint swings, the pelvis travels, turns and tilts."""
    time = np.arange(101) / 50
    qpos = np.zeros((101, 30))
    qpos[:, :3] = np.stack([0.3 * time, 0.1 * np.sin(time), 0.8 + 0.05 * np.cos(2 * time)], axis=1)
    yaw, tilt = 0.8 * time, 0.2 * np.sin(3 * time)
    qpos[:, 3] = np.cos(yaw / 2) * np.cos(tilt / 2)
    qpos[:, 4] = np.cos(yaw / 2) * np.sin(tilt / 2)
    qpos[:, 5] = np.sin(yaw / 2) * np.sin(tilt / 2)
    qpos[:, 6] = np.sin(yaw / 2) * np.cos(tilt / 2)
    phases = np.linspace(0, 5, 23)
    qpos[:, 7:] = robot.default_joint_pos_rad + 0.2 * np.sin(2 * time[:, None] + phases)
    return qpos


@pytest.fixture(scope="session")
def swaying_clip(robot: Robot, swaying_qpos: np.ndarray) -> MotionClip:
    return clip_from_qpos(swaying_qpos, 50.0, robot)


@pytest.fixture(scope="session")
def gym_text() -> str:
    return files("tlr_exp.motion.clips").joinpath("gym_motion.yaml").read_text()


@pytest.fixture(scope="session")
def gym_plan(authored) -> MotionPlan:
    return authored("gym_motion")[1]


@pytest.fixture(scope="session")
def gym_clip(authored) -> MotionClip:
    return authored("gym_motion")[0]


@pytest.fixture(scope="session")
def authored(robot: Robot, shared_folder: Path) -> Callable[[str], tuple[MotionClip, MotionPlan]]:
    """An authored motion and its plan by name, built once however many tests look at it.

    Built anew in every run of the tests, whatever the user's cache has, and by one process.
    """

    @cache
    def of(name: str) -> tuple[MotionClip, MotionPlan]:
        text = files("tlr_exp.motion.clips").joinpath(f"{name}.yaml").read_text(encoding="utf-8")
        plan = MotionPlan(read_script(text, robot.spec, HandSolver(robot)), robot)
        built = shared_folder / f"{name}.npz"
        with FileLock(f"{built}.lock"):
            if not built.exists():
                build_clip(text, robot).save(built)
        return MotionClip.load(built, robot.spec), plan

    return of
