"""The iteration of a run, and the collector that feeds it."""

from collections.abc import Callable

from tensordict import TensorDictBase
from tensordict.nn import TensorDictModule
from torchrl.collectors import Collector

from tlr_exp.assembly.split import build_split
from tlr_exp.config.settings import Settings
from tlr_exp.env.tracking import TrackingEnv
from tlr_exp.machine.cores import one_torch_thread
from tlr_exp.optimizer.protocol import WeightOptimizer
from tlr_exp.ppo.learner import Ppo
from tlr_exp.reward.box_sample import BoxSample
from tlr_exp.reward.objectives import Objective
from tlr_exp.reward.shaping import Shaping
from tlr_exp.reward.trajectories import trajectories_of
from tlr_exp.training.iteration import Trainer


def build_trainer(
    settings: Settings,
    env: TrackingEnv,
    ppo: Ppo,
    objective: Objective,
    weight_optimizer: WeightOptimizer,
) -> Trainer:
    """The training iteration over ``env``; starts its episodes, or goes on with saved ones."""
    split = build_split(settings, env.term_names)
    collect = build_collect(env, ppo.actor, settings.ppo.num_steps)
    box_sample = BoxSample(len(split.optimizing_names), objective)
    shaping = Shaping(settings.reward.shaping, split.term_names, settings.ppo.gamma)
    return Trainer(
        collect,
        split,
        shaping,
        trajectories_of(settings.reward.ranked),
        weight_optimizer,
        box_sample,
        ppo,
        settings.scale.num_envs,
    )


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
