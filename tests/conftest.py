"""What tests of several rooms share: a robot, settings, a short motion and small environments.

The motion is synthetic, so that nothing here depends on the authored ones.
"""

import copy
import dataclasses
import os
import shutil
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np
import pytest
import torch
from filelock import FileLock
from hydra import compose, initialize_config_module
from learners import build_learner
from tensordict.nn import TensorDictModule

from tests.trainer import Trainer
from tlr_exp.assembly.learner import build_ppo
from tlr_exp.assembly.terms import terms_of_training
from tlr_exp.config.load import load_settings
from tlr_exp.config.settings import Settings
from tlr_exp.env.tracking import TrackingEnv
from tlr_exp.motion.clip import MotionClip, clip_from_qpos
from tlr_exp.motion.reference import Reference
from tlr_exp.physics.native import NativePhysics
from tlr_exp.pictures.recording import Recording
from tlr_exp.ppo.learner import Ppo
from tlr_exp.records.checkpoint import CheckpointStore
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.robot.g1 import G1
from tlr_exp.robot.model import Robot, build_robot
from tlr_exp.viewing import native, web

# Time limits of single examples fail on a busy machine.
hypothesis.settings.register_profile("no_deadline", deadline=None)
hypothesis.settings.load_profile("no_deadline")

# Where tests train, serve, draw or start commands. Those that take longest come first, so that no
# core waits for them at the end; `--fast` leaves all of them out, what is marked `simulation`, and
# what compares with mealpy, whose searches take seconds.
LONG = (
    *("integration", "training", "commands", "mlflow_sync", "benchmarks", "motion/authoring"),
    *("export", "pictures", "analysis/report", "analysis/figures", "analysis/commands"),
    *("analysis/data/test_load.py", "analysis/test_several_motions.py", "ppo/test_learning.py"),
    *("machine/test_terminal.py", "sweeps/test_plan.py", "motion/importers/test_plausible.py"),
    "motion/importers/test_hostile.py",
    *("evaluation", "viewing", "physics", "cluster"),
)

MEMORY = "/dev/shm"  # where Linux keeps files in memory
CLIP_FRAMES = 41
PELVIS_HEIGHT_M = 0.78


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--fast", action="store_true", help="leave out what trains, serves, draws or simulates"
    )


def pytest_configure() -> None:
    if _memory_has_room():
        # MLflow's stores and the records of runs wait for a disk at every step; here for none.
        os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", MEMORY)
    if "PYTEST_XDIST_WORKER" in os.environ:
        # As many processes as cores: more threads, here and in commands, would only wait.
        torch.set_num_threads(1)
        os.environ.setdefault("OMP_NUM_THREADS", "1")


def _memory_has_room() -> bool:
    """Whether files can lie in memory: some containers give little, or start no program there."""
    try:
        there = os.statvfs(MEMORY)
    except OSError:
        return False
    return there.f_bavail * there.f_frsize > 4 * 2**30 and not there.f_flag & os.ST_NOEXEC


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    return True if config.option.fast and rank(collection_path) < len(LONG) else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: rank(item.path))
    if config.option.fast:
        config.hook.pytest_deselected(items=[item for item in items if _takes_seconds(item)])
        items[:] = [item for item in items if not _takes_seconds(item)]


def _takes_seconds(item: pytest.Item) -> bool:
    return item.get_closest_marker("simulation") is not None or "mealpy" in item.nodeid


def rank(path: Path) -> int:
    """The number in LONG of what the path lies in, or a number beyond them all."""
    inner = f"{os.path.relpath(path, Path(__file__).parent)}/"
    return next((n for n, place in enumerate(LONG) if inner.startswith(f"{place}/")), len(LONG))


@pytest.fixture
def trainer(tmp_path: Path, short_clip_path: Path) -> Iterator[Trainer]:
    trainer = Trainer(tmp_path, short_clip_path)
    yield trainer
    trainer.close()


@pytest.fixture(scope="session")
def shared_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of the test run that all its processes see. What they make in it, they lock."""
    own = tmp_path_factory.getbasetemp()
    return own.parent if "PYTEST_XDIST_WORKER" in os.environ else own


@pytest.fixture(scope="session")
def robot() -> Robot:
    return build_robot()


@pytest.fixture(scope="session")
def short_clip(robot: Robot) -> MotionClip:
    """0.8 s at 50 Hz: standing, while the arms swing, the torso bends and the pelvis sways."""
    time = np.arange(CLIP_FRAMES) / 50
    qpos = np.zeros((CLIP_FRAMES, 30))
    qpos[:, 0] = 0.02 * time
    qpos[:, 1] = 0.01 * np.sin(4 * time)
    qpos[:, 2] = PELVIS_HEIGHT_M
    # Half angles of a yaw: the heading turns by 0.1 rad/s.
    qpos[:, 3], qpos[:, 6] = np.cos(0.05 * time), np.sin(0.05 * time)
    qpos[:, 7:] = robot.default_joint_pos_rad
    for name, amplitude in (("waist_pitch", 0.1), ("left_elbow", 0.4), ("right_elbow", -0.3)):
        column = 7 + G1.joint_names.index(f"{name}_joint")
        qpos[:, column] += amplitude * np.sin(5 * time)
    return clip_from_qpos(qpos, 50.0, robot)


@pytest.fixture(scope="session")
def short_clip_path(short_clip: MotionClip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The short motion as a file that ``env.motion`` can name."""
    path = tmp_path_factory.mktemp("motion") / "short.npz"
    short_clip.save(path)
    return path


@pytest.fixture(scope="session")
def settings_of(short_clip_path: Path) -> Callable[..., Settings]:
    """``settings_of(*overrides)``: checked settings of ``conf/``, on the short motion.

    By the paper's recipe, for whose values the arithmetic of the tests was done.
    """
    motion = f"env.motion={short_clip_path}"

    @cache
    def load(*overrides: str) -> Settings:
        with initialize_config_module("tlr_exp.conf", version_base="1.3"):
            recipe = [] if "recipe=fast" in overrides else ["recipe=paper"]
            return load_settings(compose("config", [*recipe, motion, "study=test", *overrides]))

    def fresh(*overrides: str) -> Settings:
        return copy.deepcopy(load(*overrides))

    return fresh


MakeEnv = Callable[..., TrackingEnv]


@pytest.fixture(scope="session")
def make_env(robot: Robot, short_clip: MotionClip, settings_of: Callable[..., Settings]) -> MakeEnv:
    """``make_env(*overrides, num_envs=4, seed=0, clip=..., failures=True, ...)``.

    A ``TrackingEnv`` on the C engine with the reward terms of the configuration.
    """

    def make(
        *overrides: str,
        num_envs: int = 4,
        seed: int = 0,
        clip: MotionClip = short_clip,
        **arguments: Any,
    ) -> TrackingEnv:
        settings = settings_of(*overrides)
        return TrackingEnv(
            physics=NativePhysics(robot, num_envs, num_threads=1),
            reference=Reference(clip),
            robot=robot,
            terms=terms_of_training(settings),
            settings=settings.env,
            seed=seed,
            **arguments,
        )

    return make


@pytest.fixture
def make_ppo(settings_of) -> Callable[..., Ppo]:
    """``make_ppo(*overrides, seed=0, critic=None)``: a small learner of the configuration."""

    def make(*overrides: str, seed: int = 0, critic: TensorDictModule | None = None) -> Ppo:
        return build_learner(settings_of("ppo.hidden_sizes=[16]", *overrides).ppo, seed, critic)

    return make


@pytest.fixture(scope="session")
def untrained_run(
    settings_of: Callable[..., Settings], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A run directory with one checkpoint, whose policy was drawn and not trained. Only read."""
    settings = settings_of("ppo.hidden_sizes=[16]", "scale.num_envs=16")
    path = tmp_path_factory.mktemp("runs") / "a-run"
    RunDirectory.create(path, dataclasses.asdict(settings), tags={})
    state = {"trainer": {"ppo": build_ppo(settings).state_dict()}}
    CheckpointStore(path / "checkpoints", keep_last=1).save(5, state)
    return path


@pytest.fixture
def shown_recordings(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Recording, int | None]]:
    """What the viewers would show, which are stood in for: recordings, with the port for one."""
    shown: list[tuple[Recording, int | None]] = []
    monkeypatch.setattr(native, "require_display", lambda: None)
    monkeypatch.setattr(web, "require_packages", lambda: None)
    monkeypatch.setattr(native, "view", lambda recording, robot: shown.append((recording, None)))
    monkeypatch.setattr(
        web, "serve", lambda recording, robot, port: shown.append((recording, port))
    )
    return shown


@pytest.fixture(scope="session")
def made_store(shared_folder: Path) -> Path:
    """An empty MLflow store, made once because that takes seconds; tests get copies."""
    database = shared_folder / "mlflow.db"
    with FileLock(shared_folder / "mlflow.lock"):
        if not database.exists():
            from tlr_exp.mlflow_sync.store import open_client

            open_client(f"sqlite:///{database}")
    return database


@pytest.fixture
def database(made_store: Path, tmp_path: Path) -> Path:
    """An empty MLflow store of the test's own."""
    return Path(shutil.copy(made_store, tmp_path / "mlflow.db"))
