"""Builds the parts of a run from its settings: who gets what, and which random stream."""

import copy
import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModule
from torchrl.collectors import Collector

from tlr_exp import g1, keys
from tlr_exp.config import ConfigError, instantiate
from tlr_exp.cores import one_torch_thread
from tlr_exp.env import TrackingEnv
from tlr_exp.landscape import BoxSample
from tlr_exp.mdp.observations import OBSERVATION_DIMS, PRIVILEGED_DIM
from tlr_exp.mdp.starts import even_frames
from tlr_exp.motion.clip import MotionClip, resample
from tlr_exp.motion.keyframes import load_motion
from tlr_exp.motion.reference import Reference
from tlr_exp.networks import build_actor, build_critic, set_precision
from tlr_exp.objective import Objective
from tlr_exp.ppo import Ppo
from tlr_exp.precision import chosen_precision
from tlr_exp.reward import RewardSplit
from tlr_exp.robot import Robot, build_robot
from tlr_exp.settings import EnvSettings, ResetNoise, Settings
from tlr_exp.trainer import Trainer

LIMIT_MARGIN = 0.1  # epsilon of Table 1, for limit terms that only an evaluation reports


@dataclass(frozen=True)
class Seeds:
    """Independent random streams of one run, all from its seed."""

    env: int
    networks: int
    exploration: int
    minibatches: int
    weights: int

    @classmethod
    def of(cls, seed: int) -> "Seeds":
        # 63 bits: the largest seed that both torch and NumPy take.
        states = np.random.SeedSequence(seed).generate_state(5, dtype=np.uint64) >> np.uint64(1)
        return cls(*(int(state) for state in states))


def build_robot_of(settings: EnvSettings, visuals: bool = False) -> Robot:
    """The robot of a configuration, with meshes where pictures are made of it."""
    robot = settings.robot
    return build_robot(robot.mjcf, robot.gains, robot.collisions, visuals)


def build_clip(settings: EnvSettings, robot: Robot) -> MotionClip:
    """The motion of a configuration at the control rate."""
    clip = load_motion(settings.motion, robot)
    rate_hz = 1.0 / g1.CONTROL_DT_S
    return clip if clip.fps == rate_hz else resample(clip, rate_hz, robot)


def build_split(settings: Settings) -> RewardSplit:
    """The two layers, the lower one at its configured scale."""
    reward = settings.reward
    optimizing = {name: reward.penalty_scale * value for name, value in reward.optimizing.items()}
    return RewardSplit(reward.goal, optimizing, g1.CONTROL_DT_S)


def build_judged_split(settings: Settings) -> RewardSplit:
    """The two layers as an evaluation judges them: the lower one at full scale.

    So runs whose lower layer was trained at different scales can be compared.
    """
    return RewardSplit(settings.reward.goal, settings.reward.optimizing, g1.CONTROL_DT_S)


def build_env(settings: Settings, robot: Robot, clip: MotionClip) -> TrackingEnv:
    """The environment that a run trains in."""
    return _build_env(settings, settings.env, robot, clip, settings.scale.num_envs)


def build_evaluation_env(
    settings: Settings,
    robot: Robot,
    clip: MotionClip,
    starts: int = 1,
    key: str = "scale.evaluate_starts",
) -> TrackingEnv:
    """A robot for each of ``starts`` evenly spaced phases, 0 first; no noise, no end by a failure.

    It reports every lower-layer term of the paper, also those that the run's reward has not.

    Raises:
        ConfigError: the motion is too short for so many; ``key`` says where the number comes from.
    """
    settings = copy.deepcopy(settings)
    for name in keys.PAPER_LOWER_LAYER:
        if name not in (*settings.reward.goal, *settings.reward.optimizing):
            settings.reward.optimizing[name] = 0.0
            margins = dict.fromkeys(keys.TERM_PARAMETERS[name], LIMIT_MARGIN)
            settings.reward.parameters[name] = margins
    no_noise = ResetNoise(*(0.0 for _ in dataclasses.fields(ResetNoise)))
    env_settings = dataclasses.replace(settings.env, start_phase="zero", reset_noise=no_noise)
    try:
        frames = even_frames(clip.num_frames - 1 - settings.env.reference_lead, starts, key)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    env = _build_env(settings, env_settings, robot, clip, starts, failures=False)
    env.start_at(frames)
    return env


def _build_env(
    settings: Settings,
    env_settings: EnvSettings,
    robot: Robot,
    clip: MotionClip,
    num_envs: int,
    failures: bool = True,
) -> TrackingEnv:
    reward = settings.reward
    return TrackingEnv(
        physics=instantiate(
            settings.physics, robot=robot, num_envs=num_envs, device=settings.device
        ),
        reference=Reference(clip, settings.device),
        robot=robot,
        terms={name: reward.parameters.get(name, {}) for name in build_split(settings).term_names},
        settings=env_settings,
        seed=Seeds.of(settings.seed).env,
        failures=failures,
    )


def build_ppo(settings: Settings) -> Ppo:
    """Actor, critic and learner on the run's device."""
    seeds, device = Seeds.of(settings.seed), check_device(settings.device)
    observation_dim = OBSERVATION_DIMS[settings.env.observation]
    exploration = torch.Generator(device=device).manual_seed(seeds.exploration)
    # The layers draw their first weights from the global generator: give them one of their own.
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seeds.networks)
        actor = build_actor(observation_dim, g1.NUM_JOINTS, settings.ppo, exploration)
        critic = build_critic(observation_dim, PRIVILEGED_DIM, settings.ppo)
    precision = chosen_precision(settings.precision, settings.device)
    for network in (actor, critic):
        network.to(device)
        set_precision(network, precision)
    return Ppo(actor, critic, settings.ppo, seeds.minibatches, exploration)


def build_trainer(settings: Settings, env: TrackingEnv, ppo: Ppo) -> Trainer:
    """The training iteration over ``env``; starts (or after a restoration resumes) its episodes."""
    split = build_split(settings)
    collect = build_collect(env, ppo.actor, settings.ppo.num_steps)
    objective = instantiate(settings.reward.objective)
    weight_optimizer = build_weight_optimizer(settings, split, objective)
    box_sample = BoxSample(len(split.optimizing_names), objective)
    return Trainer(collect, split, weight_optimizer, box_sample, ppo, settings.scale.num_envs)


def build_collect(
    env: TrackingEnv, policy: TensorDictModule, num_steps: int
) -> Callable[[], TensorDictBase]:
    """A function whose every call returns the next batch [num_envs, num_steps].

    On the CPU it collects with one PyTorch thread (see ``one_torch_thread``). There, too, the next
    call overwrites the tensors of the batch, which saves a copy of it.
    """
    collector = Collector(
        env,
        policy,
        frames_per_batch=env.batch_size[0] * num_steps,
        total_frames=-1,
        track_traj_ids=False,
        auto_register_policy_transforms=False,
        return_same_td=env.device.type == "cpu",
    )
    batches = iter(collector)

    def collect() -> TensorDictBase:
        if env.device.type != "cpu":
            return next(batches)
        with one_torch_thread("cpu"):
            # The entries are the collector's: what is added to the batch must not reach them.
            return next(batches).copy()

    return collect


def build_weight_optimizer(settings: Settings, split: RewardSplit, objective: Objective):
    """The lower layer's optimizer; it works on the CPU, where its small tensors are fastest."""
    return instantiate(
        settings.optimizer,
        num_terms=len(split.optimizing_names),
        objective=objective,
        seed=Seeds.of(settings.seed).weights,
        device="cpu",
    )


def check_device(name: str) -> torch.device:
    """The device of that name.

    Raises:
        ConfigError: it is not there.
    """
    if name != "cpu" and not torch.cuda.is_available():
        raise ConfigError(
            f"device is {name!r}, but PyTorch finds no CUDA device here; allowed: cpu"
        )
    device = torch.device(name)
    if (device.index or 0) >= max(1, torch.cuda.device_count()):
        raise ConfigError(
            f"device is {name!r}; allowed: cpu, cuda:0 to cuda:{torch.cuda.device_count() - 1}"
        )
    return device
