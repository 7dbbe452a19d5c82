"""Observations: what stands where, and base-frame transforms against SciPy."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from tlr_exp.env import observations
from tlr_exp.env.instant import Instant
from tlr_exp.physics.state import PhysicsState
from tlr_exp.robot.g1 import G1

NUM_ENVS = 3


@pytest.fixture
def default_pose(robot) -> torch.Tensor:
    return torch.tensor(robot.default_joint_pos_rad, dtype=torch.float32)


@pytest.fixture
def action() -> torch.Tensor:
    return torch.randn(NUM_ENVS, 23, generator=torch.Generator().manual_seed(7))


def base_rotation(state: PhysicsState, env: int) -> Rotation:
    return Rotation.from_quat(state.qpos[env, 3:7].numpy(), scalar_first=True)


def to_base(state: PhysicsState, env: int, vectors_w: torch.Tensor) -> np.ndarray:
    """World vectors in the base frame of one environment, flat."""
    return base_rotation(state, env).apply(vectors_w.numpy(), inverse=True).ravel()


def assert_near(found: torch.Tensor, expected: np.ndarray | torch.Tensor) -> None:
    np.testing.assert_allclose(found.numpy(), np.asarray(expected), atol=2e-6, rtol=1e-5)


# --- history ---------------------------------------------------------------------------------


def test_sizes_are_those_of_the_paper():
    # Eq. 4: five frames of q, dq and action (23 each), angular velocity and gravity (3 each),
    # and the phase: 5 * 75 + 1. Section 4.1: pose 7, twist 6, q, dq, action, 27 bodies twice.
    assert observations.observation_dims(G1) == {"history": 376, "reference": 244}
    assert observations.privileged_dim(G1) == 165


def test_one_frame_of_the_history(unrelated, action, default_pose):
    step = unrelated(NUM_ENVS)
    state = step.state
    frame = observations.proprioception(step.instant, action, default_pose)
    assert frame.shape == (NUM_ENVS, 75)
    assert_near(frame[:, :23], state.qpos[:, 7:] - default_pose)
    assert_near(frame[:, 23:46], state.qvel[:, 6:] / 20)  # ASAP's scale 0.05
    assert_near(frame[:, 46:49], state.qvel[:, 3:6] / 4)  # ASAP's scale 0.25
    for env in range(NUM_ENVS):
        assert_near(frame[env, 49:52], to_base(state, env, torch.tensor([0.0, 0.0, -1.0])))
    assert_near(frame[:, 52:], action)


def test_history_begins_with_five_times_the_first_frame():
    frame = torch.arange(150.0).reshape(2, 75)
    history = observations.first_history(frame, torch.tensor([[0.25], [0.5]]))
    assert history.shape == (2, 376)
    for k in range(5):
        assert torch.equal(history[:, 75 * k : 75 * (k + 1)], frame)
    assert history[:, -1].tolist() == [0.25, 0.5]


def test_history_shifts_by_one_frame_a_step_newest_first():
    frames = [torch.full((2, 75), float(k)) for k in range(8)]
    history = observations.first_history(frames[0], torch.zeros(2, 1))
    for k, frame in enumerate(frames[1:], start=1):
        history = observations.next_history(frame, history, torch.full((2, 1), k / 10))
        assert history.shape == (2, 376)
        expected = [max(0.0, k - age) for age in range(5)]
        assert history[:, 0:375:75].tolist() == [expected, expected]
        assert history[:, 74:375:75].tolist() == [expected, expected]
        torch.testing.assert_close(history[:, 375], torch.full((2,), k / 10))


# --- reference and privileged ----------------------------------------------------------------


def test_reference_observation(unrelated, action, default_pose):
    step = unrelated(NUM_ENVS)
    state, reference = step.state, step.reference
    found = observations.reference_observation(step.instant, action, default_pose)
    assert found.shape == (NUM_ENVS, 244)
    parts = found.split([7, 3, 3, 23, 23, 23, 81, 81], dim=1)
    pose, lin_vel, ang_vel, joint_pos, joint_vel, last_action, body_pos, body_vel = parts
    assert_near(pose, state.qpos[:, :7])
    assert_near(ang_vel, state.qvel[:, 3:6] / 4)
    assert_near(joint_pos, state.qpos[:, 7:] - default_pose)
    assert_near(joint_vel, state.qvel[:, 6:] / 20)
    assert_near(last_action, action)
    for env in range(NUM_ENVS):
        assert_near(lin_vel[env], 2 * to_base(state, env, state.qvel[env, :3]))
        from_pelvis = reference.body_pos_w[env] - state.qpos[env, :3]
        assert_near(body_pos[env], to_base(state, env, from_pelvis))
        assert_near(body_vel[env], to_base(state, env, reference.body_lin_vel_w[env]))


def test_privileged_observation(unrelated):
    step = unrelated(NUM_ENVS)
    state, reference = step.state, step.reference
    found = observations.privileged_observation(step.instant)
    assert found.shape == (NUM_ENVS, 165)
    for env in range(NUM_ENVS):
        assert_near(found[env, :3], 2 * to_base(state, env, state.qvel[env, :3]))
        from_pelvis = reference.body_pos_w[env] - state.qpos[env, :3]
        assert_near(found[env, 3:84], to_base(state, env, from_pelvis))
        error = reference.body_pos_w[env] - state.body_pos_w[env]
        assert_near(found[env, 84:], to_base(state, env, error))


def test_what_the_base_sees_does_not_change_with_place_and_heading(unrelated, action, default_pose):
    """Turn the world about z and shift it: only the base pose in the world may change."""
    step = unrelated(NUM_ENVS)
    turn, shift = Rotation.from_rotvec([0.0, 0.0, 2.1]), np.array([3.0, -2.0, 0.5])
    moved = _moved(step.instant, turn, shift)
    before = observations.reference_observation(step.instant, action, default_pose)
    after = observations.reference_observation(moved, action, default_pose)
    assert_near(after[:, 7:], before[:, 7:])
    assert not torch.allclose(after[:, :7], before[:, :7])
    assert_near(
        observations.privileged_observation(moved),
        observations.privileged_observation(step.instant),
    )
    assert_near(
        observations.proprioception(moved, action, default_pose),
        observations.proprioception(step.instant, action, default_pose),
    )


def _moved(instant: Instant, turn: Rotation, shift: np.ndarray) -> Instant:
    state, reference = instant.state, instant.reference

    def turned(vectors: torch.Tensor) -> torch.Tensor:
        flat = turn.apply(vectors.reshape(-1, 3).double().numpy())
        return torch.tensor(flat, dtype=torch.float32).reshape(vectors.shape)

    qpos, qvel = state.qpos.clone(), state.qvel.clone()
    offset = torch.tensor(shift, dtype=torch.float32)
    qpos[:, :3] = turned(qpos[:, :3]) + offset
    for env in range(NUM_ENVS):
        quat = (turn * base_rotation(state, env)).as_quat(scalar_first=True)
        qpos[env, 3:7] = torch.tensor(quat)
    qvel[:, :3] = turned(qvel[:, :3])
    bodies = turned(state.body_pos_w) + offset
    return Instant(
        state._replace(qpos=qpos, qvel=qvel, body_pos_w=bodies),
        reference._replace(
            body_pos_w=turned(reference.body_pos_w) + offset,
            body_lin_vel_w=turned(reference.body_lin_vel_w),
        ),
        G1,
    )
