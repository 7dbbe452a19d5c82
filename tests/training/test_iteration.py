"""One training iteration around a weight optimizer: what it is told, and with what it is used."""

import pytest
import torch
from tensordict import TensorDict

from tlr_exp import keys
from tlr_exp.optimizer.fixed import FixedWeights
from tlr_exp.optimizer.protocol import TrainingProgress, WeightUpdate
from tlr_exp.ppo.learner import PpoDiagnostics
from tlr_exp.reward.box_sample import BoxSample
from tlr_exp.reward.objectives import RankDeviation
from tlr_exp.reward.shaping import Shaping
from tlr_exp.reward.split import RewardSplit
from tlr_exp.reward.trajectories import Segments
from tlr_exp.training.iteration import Trainer

NUM_ENVS, NUM_STEPS = 4, 6


class FakePpo:
    """Learns nothing; the rewards that it was given are kept."""

    def __init__(self) -> None:
        self.rewards: list[torch.Tensor] = []

    def estimate_advantages(self, batch: TensorDict) -> None:
        self.rewards.append(batch["next", keys.REWARD].clone())

    def update(self, batch: TensorDict, progress: float) -> PpoDiagnostics:
        return PpoDiagnostics(*[0.0] * 8)


class Listening(FixedWeights):
    """Notes in which order it is told and asked."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.heard: list[TrainingProgress | str] = []

    def observe(self, progress: TrainingProgress) -> None:
        self.heard.append(progress)

    def update(self, *returns: torch.Tensor) -> WeightUpdate:
        self.heard.append("update")
        return super().update(*returns)


def batch_of(done: torch.Tensor) -> TensorDict:
    generator = torch.Generator().manual_seed(0)
    after = {
        name: torch.rand(NUM_ENVS, NUM_STEPS, 1, generator=generator)
        for name in (keys.UPPER_BODY_ERROR, keys.LOWER_BODY_ERROR, keys.JOINT_ERROR)
    }
    nowhere = torch.zeros(NUM_ENVS, NUM_STEPS, 1, dtype=torch.bool)
    after |= dict.fromkeys((keys.UNSTABLE, keys.FELL, keys.TERMINATED), nowhere)
    after[keys.PHASE] = torch.zeros(NUM_ENVS, NUM_STEPS, 1)
    after[keys.TRUNCATED] = done[..., None]
    after[keys.REWARD_TERMS] = torch.rand(NUM_ENVS, NUM_STEPS, 2, generator=generator)
    after[keys.DONE] = done[..., None]
    return TensorDict({"next": after}, [NUM_ENVS, NUM_STEPS])


def test_the_optimizer_hears_how_long_episodes_last_before_it_is_asked() -> None:
    # The first environment ends after its steps 2 and 5 of the first batch, the second at its
    # step 3 of the second one, after 6 + 3: lengths 2, 3, then 9 as well.
    first, second = torch.zeros(2, NUM_ENVS, NUM_STEPS, dtype=torch.bool)
    first[0, 1] = first[0, 4] = second[1, 2] = True
    batches = iter([batch_of(first), batch_of(second)])
    objective = RankDeviation(0.5)
    optimizer, ppo = Listening(num_terms=1, objective=objective, seed=0, device="cpu"), FakePpo()
    trainer = Trainer(
        collect=lambda: next(batches),
        split=RewardSplit(
            {"body_pos": 1.0}, {"ang_vel_xy": -1.0}, 0.02, ["body_pos", "ang_vel_xy"]
        ),
        shaping=Shaping([], ["body_pos", "ang_vel_xy"], 0.99),
        trajectories=Segments(),
        weight_optimizer=optimizer,
        box_sample=BoxSample(1, objective),
        ppo=ppo,  # type: ignore[arg-type]
        num_envs=NUM_ENVS,
    )
    metrics = [trainer.train_iteration() for _ in range(2)]
    mean_cost = batch_of(first)["next", keys.REWARD_TERMS][..., 1].mean().item()
    costs = {"ang_vel_xy": pytest.approx(mean_cost)}
    # The only goal term: its mean is the share of the largest goal reward.
    share = pytest.approx(batch_of(first)["next", keys.REWARD_TERMS][..., 0].mean().item())
    assert optimizer.heard == [
        TrainingProgress(pytest.approx(2.5), NUM_STEPS, costs, share),
        "update",
        TrainingProgress(pytest.approx(14 / 3), NUM_STEPS, costs, share),
        "update",
    ]
    assert [m[keys.EPISODE_LENGTH] for m in metrics] == [2.5, pytest.approx(14 / 3)]
    assert [m[keys.ENV_STEPS] for m in metrics] == [24, 48]
    # At the weight 1, r = 0.02 (body_pos - ang_vel_xy).
    terms = batch_of(first)["next", keys.REWARD_TERMS]
    torch.testing.assert_close(ppo.rewards[0], 0.02 * (terms[..., :1] - terms[..., 1:]))
