"""How far the robot is from its reference: what the paper's Figures 7 and 8 plot."""

from torch import Tensor

from tlr_exp import g1, keys
from tlr_exp.motion.reference import ReferenceFrame
from tlr_exp.physics.state import PhysicsState


def tracking_errors(state: PhysicsState, reference: ReferenceFrame) -> dict[str, Tensor]:
    """Mean distance of the upper and the lower bodies (m) and of the joints (rad), [num_envs, 1].

    The distance of a body is Euclidean, in the world frame (ASAP's evaluation metric).
    """
    distance = (reference.body_pos_w - state.body_pos_w).norm(dim=-1)
    joint_error = (reference.qpos[:, 7:] - state.qpos[:, 7:]).abs()
    return {
        keys.UPPER_BODY_ERROR: distance[:, g1.UPPER_BODY].mean(-1, keepdim=True),
        keys.LOWER_BODY_ERROR: distance[:, g1.LOWER_BODY].mean(-1, keepdim=True),
        keys.JOINT_ERROR: joint_error.mean(-1, keepdim=True),
    }
