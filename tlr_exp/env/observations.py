"""What the actor and the critic see: pure functions of one instant.

Joint positions are taken relative to the default pose; scales are those of ASAP.
"""

from torch import Tensor, cat

from tlr_exp.env.instant import Instant
from tlr_exp.env.rotations import into_frame
from tlr_exp.robot.spec import RobotSpec

LIN_VEL_SCALE = 2.0
ANG_VEL_SCALE = 0.25
JOINT_VEL_SCALE = 0.05

HISTORY_LENGTH = 5


def observation_dims(spec: RobotSpec) -> dict[str, int]:
    """Width of each observation: 376 and 244 for the G1."""
    return {
        "history": HISTORY_LENGTH * (3 * spec.num_joints + 6) + 1,
        "reference": 13 + 3 * spec.num_joints + 6 * spec.num_bodies,
    }


def privileged_dim(spec: RobotSpec) -> int:
    """Width of ``privileged_observation``: 165 for the G1."""
    return 3 + 6 * spec.num_bodies


def proprioception(instant: Instant, action: Tensor, default_joint_pos: Tensor) -> Tensor:
    """One frame of Eq. 4 of the paper: q, dq, root angular velocity, gravity, action; [n, 75]."""
    state = instant.state
    return cat(
        (
            state.qpos[:, 7:] - default_joint_pos,
            state.qvel[:, 6:] * JOINT_VEL_SCALE,
            state.qvel[:, 3:6] * ANG_VEL_SCALE,
            instant.gravity_b,
            action,
        ),
        dim=-1,
    )


def first_history(frame: Tensor, phase: Tensor) -> Tensor:
    """The history at the start of an episode: five times its first frame, and the phase [n, 1]."""
    return cat((*(frame,) * HISTORY_LENGTH, phase), dim=-1)


def next_history(frame: Tensor, previous: Tensor, phase: Tensor) -> Tensor:
    """Push ``frame`` [n, 75] in front of the ``previous`` history [n, 376] (Eq. 4 of the paper)."""
    return cat((frame, previous[:, : (HISTORY_LENGTH - 1) * frame.shape[-1]], phase), dim=-1)


def reference_observation(instant: Instant, action: Tensor, default_joint_pos: Tensor) -> Tensor:
    """The observation of section 4.1 of the paper, [n, 244].

    Base pose (world), base velocities (base frame), joint positions and velocities, last action,
    and the positions and velocities of the reference bodies, seen from the robot's pelvis.
    """
    state = instant.state
    return cat(
        (
            state.qpos[:, :7],
            instant.base_lin_vel_b * LIN_VEL_SCALE,
            state.qvel[:, 3:6] * ANG_VEL_SCALE,
            state.qpos[:, 7:] - default_joint_pos,
            state.qvel[:, 6:] * JOINT_VEL_SCALE,
            action,
            instant.reference_pos_b.flatten(1),
            into_frame(instant.reference.body_lin_vel_w, instant.base_rotation).flatten(1),
        ),
        dim=-1,
    )


def actor_observation(
    kind: str,
    instant: Instant,
    action: Tensor,
    default_joint_pos: Tensor,
    phase: Tensor,
    before: Tensor | None = None,
) -> Tensor:
    """What the actor sees, [n, OBSERVATION_DIMS[kind]].

    ``phase`` [n, 1] is that of the motion; ``before`` is what the actor saw a step ago, None at the
    start of an episode.
    """
    if kind == "reference":
        return reference_observation(instant, action, default_joint_pos)
    frame = proprioception(instant, action, default_joint_pos)
    return first_history(frame, phase) if before is None else next_history(frame, before, phase)


def privileged_observation(instant: Instant) -> Tensor:
    """What only the critic sees, [n, 165].

    Base linear velocity, positions of the reference bodies and the bodies' position errors, all
    in the base frame.
    """
    return cat(
        (
            instant.base_lin_vel_b * LIN_VEL_SCALE,
            instant.reference_pos_b.flatten(1),
            into_frame(instant.body_pos_error_w, instant.base_rotation).flatten(1),
        ),
        dim=-1,
    )
