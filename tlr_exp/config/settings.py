"""The type of every configuration group. The values stand in ``conf/``, each once.

Plain dataclasses without defaults: this module imports nothing heavy, so that a mistake in a
configuration is found before anything that takes seconds is loaded.
"""

from dataclasses import dataclass
from typing import Any


@dataclass
class TerminationSettings:
    """Limits beyond which an episode has failed.

    Attributes:
        max_tilt: largest |x| or |y| component of the projected gravity (1 = lying down).
        distance_start_m: largest distance of a tracked body from its reference, at first.
        distance_end_m: the same once it has tightened.
        distance_max_m: the largest that it loosens to; null: ``distance_start_m``.
        tighten_rate: share by which the limit changes in one control step.
        tighten_above_steps: it shrinks while the mean episode is longer than this.
        loosen_below_steps: it grows back while the mean episode is shorter than this.
        mean_episodes: about how many finished episodes the mean is of; null: one per environment.
    """

    max_tilt: float
    distance_start_m: float
    distance_end_m: float
    distance_max_m: float | None
    tighten_rate: float
    tighten_above_steps: float
    loosen_below_steps: float
    mean_episodes: int | None


@dataclass
class ResetNoise:
    """Half-widths of the uniform noise on the state that is copied from the reference.

    Units: m, rad, m/s, rad/s, rad, rad/s; zero everywhere leaves the reference as it is.
    """

    root_pos_m: float
    root_rot_rad: float
    root_lin_vel: float
    root_ang_vel: float
    joint_pos_rad: float
    joint_vel: float


@dataclass
class ObservationNoise:
    """Noise on what the actor sees, drawn anew for every value at every control step.

    Half-widths where ``distribution`` is ``uniform``, standard deviations where it is ``gaussian``,
    in rad/s, rad, rad, rad/s, rad, m and m/s; zero everywhere is none.
    """

    distribution: str
    gyro: float
    gravity: float
    joint_pos: float
    joint_vel: float
    heading: float
    root_pos: float
    root_lin_vel: float


@dataclass
class Disturbances:
    """What happens to robots and differs between them: ranges [low, high] to draw from, or null.

    Attributes:
        push_m_s: size of the sudden changes of the pelvis's horizontal velocity.
        push_every_s: time between two of them.
        delay_steps: control steps by which joint targets are late, whole numbers.
        friction: sliding coefficient of all contacts.
        mass: factor of each body's mass and inertia.
        com_m: distance by which the torso's centre of mass is moved.
        kp, kd, armature: factors of each joint's gains and armature.
    """

    push_m_s: list[float] | None
    push_every_s: list[float] | None
    delay_steps: list[int] | None
    friction: list[float] | None
    mass: list[float] | None
    com_m: list[float] | None
    kp: list[float] | None
    kd: list[float] | None
    armature: list[float] | None


@dataclass
class RobotSettings:
    """Which model: PD gains, contacts, and a model file of the user's own (or null)."""

    mjcf: str | None
    gains: str
    collisions: str


@dataclass
class EnvSettings:
    """The motion-tracking environment; see ``tlr_exp.env.tracking.TrackingEnv``."""

    motion: str
    robot: RobotSettings
    observation: str
    action: str
    reference_lead: int
    start_phase: str
    reset_noise: ResetNoise
    noise: ObservationNoise
    disturbance: Disturbances
    termination: TerminationSettings


@dataclass
class RewardSettings:
    """Coefficients of the two layers, constants inside the terms, and the objective J.

    Attributes:
        goal: coefficient of each upper-layer term.
        optimizing: coefficient of each lower-layer term, which the weights in [0, 1] multiply.
        penalty_scale: multiplies the coefficients of all lower-layer terms.
        parameters: constants of the terms, by term.
        sigma_rate: at which sigmas of tracking terms follow the errors, per control step; null:
            they stay (``tlr_exp.env.temperatures``).
        shaping: lower-layer terms that act as potentials (``tlr_exp.reward.shaping``).
        ranked: what a trajectory is that the search ranks (``tlr_exp.reward.trajectories``).
        objective: what the weight optimizer minimises (``_target_`` and its settings).
    """

    goal: dict[str, float]
    optimizing: dict[str, float]
    penalty_scale: float
    parameters: dict[str, dict[str, float]]
    sigma_rate: float | None
    shaping: list[str]
    ranked: str
    objective: dict[str, Any]


@dataclass
class StageSettings:
    """One stage of a curriculum; ``conf/curriculum/hierarchical.yaml`` explains each value.

    Attributes:
        enter_when: what each fact of the training must have reached for the stage to be entered.
        weights: of lower-layer terms, while the stage lasts.
        distance_m: the distance limit that is held; null: it follows its own rule.
        start_phases: first and last share of the motion in which episodes start; null: anywhere.
    """

    enter_when: dict[str, float]
    weights: dict[str, float]
    distance_m: float | None
    start_phases: list[float] | None


@dataclass
class PpoSettings:
    """Proximal policy optimisation; ``conf/ppo/paper.yaml`` explains each value."""

    num_steps: int
    num_epochs: int
    num_minibatches: int
    gamma: float
    gae_lambda: float
    clip_epsilon: float
    value_clip: float
    critic_coeff: float
    entropy_coeff: float
    max_grad_norm: float
    learning_rate: float
    final_learning_rate: float | None
    decay_from: float
    min_learning_rate: float
    max_learning_rate: float
    target_kl: float | None
    normalize_observations: bool
    hidden_sizes: list[int]
    activation: str
    initial_std: float
    std: str


@dataclass
class ScaleSettings:
    """How much is trained, kept and evaluated, and what a run of this size is evidence for."""

    name: str
    num_envs: int
    iterations: int
    evaluate_every: int
    evaluate_starts: int
    checkpoint_every: int
    keep_checkpoints: int
    evidence: str


@dataclass
class Settings:
    """One run, whole; ``recipe`` names the set of values by which it learns (``conf/recipe``).

    ``curriculum`` likewise names the stages (``conf/curriculum``), and ``reading`` the point at
    which the paper is read differently (``conf/reading``).
    """

    recipe: str
    env: EnvSettings
    physics: dict[str, Any]
    reward: RewardSettings
    optimizer: dict[str, Any]
    curriculum: str
    reading: str
    stages: list[StageSettings]
    ppo: PpoSettings
    scale: ScaleSettings
    seed: int
    device: str
    num_threads: int
    precision: str
    study: str
    runs_dir: str
    resume: str
    init_from: str | None
    tracking_uri: str
