"""The shared vocabulary: tensordict keys and metric names.

This module imports nothing of the project, so that every other room may import it.
"""

from enum import StrEnum

# --- tensordict keys -------------------------------------------------------------------------
OBSERVATION = "observation"  # [num_envs, obs_dim], what the actor sees
PRIVILEGED = "privileged"  # [num_envs, privileged_dim], what the critic sees besides
ACTION = "action"  # [num_envs, 23]
REWARD_TERMS = "reward_terms"  # [num_envs, num_terms], raw and unweighted
REWARD = "reward"  # [num_envs, 1], written after collection by the RewardSplit
TERMINATED = "terminated"
TRUNCATED = "truncated"
DONE = "done"
UPPER_BODY_ERROR = "upper_body_error"  # [num_envs, 1], metres
LOWER_BODY_ERROR = "lower_body_error"  # [num_envs, 1], metres
JOINT_ERROR = "joint_error"  # [num_envs, 1], radians
FELL = "fell"  # [num_envs, 1], bool: the pelvis tilted too far
PHASE = "phase"  # [num_envs, 1], of the motion at the reference's instant, from 0 to 1
STATE_COSTS = (
    "state_costs"  # [num_envs, n], raw, of the state shown; only where costs are potentials
)
UNSTABLE = "unstable"  # [num_envs, 1], bool: the physics state diverged (tlr_exp/env/tracking.py)


# --- episodes --------------------------------------------------------------------------------
class Ending(StrEnum):
    """How an episode ends."""

    COMPLETED = "completed"  # the motion's end was reached
    FELL = "fell"  # the pelvis tilted too far
    TOO_FAR = "too_far"  # a body was too far from its reference
    UNSTABLE = "unstable"  # the simulation stopped being finite


# --- methods ---------------------------------------------------------------------------------
# What the arms of the paper's study are called for readers; other methods go by their own name.
METHOD_NAMES = {"fixed": "static", "gwo": "two-layered (GWO)", "random": "random weights"}

# --- metric names ----------------------------------------------------------------------------
ITERATION = "iteration"
ENV_STEPS = "train/env_steps"
EPISODE_LENGTH = "train/episode_length"
TRAIN_UPPER_BODY_ERROR = "train/upper_body_error_m"
TRAIN_LOWER_BODY_ERROR = "train/lower_body_error_m"
TRAIN_JOINT_ERROR = "train/joint_error_rad"
# Each half second after a reset counts alike (tlr_exp/training/episodes.py).
TRAIN_UPPER_BODY_ERROR_AT_EQUAL_AGES = "train/upper_body_error_at_equal_ages_m"
TRAIN_LOWER_BODY_ERROR_AT_EQUAL_AGES = "train/lower_body_error_at_equal_ages_m"
UNSTABLE_ENVS = "train/unstable_envs"
DISTANCE_LIMIT = "train/distance_limit_m"  # beyond which a body ends an episode
STAGE = "train/stage"  # of the curriculum, from 1; only where there is one
SIGMA_PREFIX = "train/sigma/"  # of a goal term; only where sigmas adapt
OBJECTIVE_BEFORE = "train/objective_before"  # J at the weights 1 (the static reward)
OBJECTIVE_AFTER = "train/objective_after"  # J at the weights in use
OPTIMAL_SHARE = "train/optimal_share"  # share of the pack that reaches the best J
BOX_OPTIMAL_SHARE = "train/box_optimal_share"  # share of the weight box with minimal J
STEP_REWARD = "train/step_reward"  # mean composed reward of a control step
PPO_PREFIX = "ppo/"
WEIGHT_PREFIX = "weight/"
OPTIMIZER_PREFIX = "optimizer/"  # what a weight optimizer tells of its own
REWARD_TERM_PREFIX = "reward_term/"
TIME_PREFIX = "time/"
EVAL_PREFIX = "eval/"
# Share of the episodes that ended in an iteration, or of roll-outs, by how they ended.
TRAIN_ENDED_BY, EVAL_ENDED_BY = "train/ended_by/", f"{EVAL_PREFIX}ended_by/"
EVAL_SUCCESS = (
    f"{EVAL_PREFIX}success"  # share of several roll-outs that no failure would have ended
)
FINAL_PREFIX = "final/"  # in MLflow alone: one number per finished run (records/final_metrics.py)
