"""The iteration of a run and what it needs besides environment and learner, from settings."""

from collections.abc import Callable

from tensordict import TensorDictBase
from tensordict.nn import TensorDictModule
from torchrl.collectors import Collector

from tlr_exp.assembly.seeds import Seeds
from tlr_exp.assembly.split import build_split
from tlr_exp.config.components import instantiate
from tlr_exp.config.settings import Settings
from tlr_exp.env.tracking import TrackingEnv
from tlr_exp.machine.cores import one_torch_thread
from tlr_exp.ppo.learner import Ppo
from tlr_exp.reward.box_sample import BoxSample
from tlr_exp.reward.objectives import Objective
from tlr_exp.reward.split import RewardSplit
from tlr_exp.training.iteration import Trainer


def build_trainer(settings: Settings, env: TrackingEnv, ppo: Ppo) -> Trainer:
    """The training iteration over ``env``; starts (or after a restoration resumes) its episodes."""
    split = build_split(settings)
    collect = build_collect(env, ppo.actor, settings.ppo.num_steps)
    objective = instantiate("reward.objective", settings.reward.objective)
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
        "optimizer",
        settings.optimizer,
        num_terms=len(split.optimizing_names),
        objective=objective,
        seed=Seeds.of(settings.seed).weights,
        device="cpu",
    )
