"""How far the robot is from its reference: what the paper's Figures 7 and 8 plot."""

from torch import Tensor

from tlr_exp import keys
from tlr_exp.env.instant import Instant


def tracking_errors(instant: Instant) -> dict[str, Tensor]:
    """Mean distance of the upper and the lower bodies (m) and of the joints (rad), [num_envs, 1].

    The distance of a body is Euclidean, in the world frame (ASAP's evaluation metric).
    """
    distance = instant.squared_distance.sqrt()
    joint_error = (instant.reference.qpos[:, 7:] - instant.state.qpos[:, 7:]).abs()
    return {
        keys.UPPER_BODY_ERROR: distance[:, instant.spec.upper_body].mean(-1, keepdim=True),
        keys.LOWER_BODY_ERROR: distance[:, instant.spec.lower_body].mean(-1, keepdim=True),
        keys.JOINT_ERROR: joint_error.mean(-1, keepdim=True),
    }
