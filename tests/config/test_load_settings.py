"""Every file of conf/ composes, instantiates and is checked; mistakes are named."""

from pathlib import Path

import pytest
from hydra import compose, initialize_config_module

from tlr_exp.config.components import instantiate
from tlr_exp.config.load import ConfigError, _reward_problems, load_settings, plain_config
from tlr_exp.config.settings import RewardSettings
from tlr_exp.config.versions import of_any_version

CONF = Path(__file__).parents[2] / "conf"


def composed(*overrides):
    with initialize_config_module("tlr_exp.conf", version_base="1.3"):
        return compose("config", list(overrides))


def choices(group):
    return [path.stem for path in sorted((CONF / group).glob("*.yaml"))]


def every_choice():
    groups = sorted(path.parent.relative_to(CONF) for path in CONF.glob("*/**/*.yaml"))
    return sorted({(str(group), name) for group in groups for name in choices(group)})


def needed_by(group, choice):
    """What a choice cannot do without: weights of stages need a stage."""
    stage = "{enter_when:{},weights:{},distance_m:null,start_phases:null}"
    return [f"stages=[{stage}]"] if (group, choice) == ("optimizer", "staged") else []


@pytest.mark.parametrize(("group", "choice"), every_choice())
def test_every_choice_composes_and_passes_the_checks(group, choice):
    if group == "sweep":
        composed(f"+{group}={choice}")
        return
    load_settings(composed(f"{group}={choice}", *needed_by(group, choice)))


@pytest.mark.parametrize("optimizer", choices("optimizer"))
@pytest.mark.parametrize("objective", choices("reward/objective"))
def test_every_optimizer_is_built_with_every_objective(optimizer, objective):
    chosen = (f"optimizer={optimizer}", f"reward/objective={objective}")
    settings = load_settings(composed(*chosen, *needed_by("optimizer", optimizer)))
    built = instantiate(
        "optimizer",
        settings.optimizer,
        num_terms=6,
        objective=instantiate("reward.objective", settings.reward.objective),
        seed=0,
        device="cpu",
    )
    assert built.num_terms == 6


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("ppo.gamma=abc", ["ppo.gamma", "abc"]),
        ("ppo.gamma=1.5", ["ppo.gamma is 1.5", "from 0 to 1"]),
        ("seed=-1", ["seed is -1", "from 0 to 2^63 - 1"]),
        ("seed=9223372036854775808", ["seed is 9223372036854775808", "from 0 to 2^63 - 1"]),
        ("env.observation=images", ["env.observation", "history, reference"]),
        ("env.noise.gyro=-1", ["env.noise.gyro is -1.0", "at least 0"]),
        ("env.noise.distribution=laplace", ["env.noise.distribution", "uniform, gaussian"]),
        ("+env.noise.sonar=1", ["there is no key env.noise.sonar", "gyro"]),
        ("env.disturbance.mass=[1.2,0.8]", ["env.disturbance.mass", "[low, high], or null"]),
        ("env.disturbance.mass=[1.2]", ["env.disturbance.mass", "[low, high], or null"]),
        ("env.disturbance.mass=[0,1]", ["env.disturbance.mass is 0.0", "above 0"]),
        ("env.disturbance.mass=1.1", ["env.disturbance.mass is no list", "[low, high], or null"]),
        ("ppo.hidden_sizes=256", ["ppo.hidden_sizes is no list; allowed: a list"]),
        ("env.disturbance.delay_steps=[0.5,1]", ["env.disturbance.delay_steps"]),
        ("env.disturbance.push_m_s=[0,1]", ["push_m_s and env.disturbance.push_every_s"]),
        ("+reward.goal.speed=1.0", ["reward.goal.speed", "body_pos"]),
        ("+reward.goal.feet_pos=1.0", ["reward.parameters.feet_pos", "sigma"]),
        ("env.motion=moonwalk", ["env.motion is 'moonwalk'", "gym_motion"]),
        ("env.motion=moonwalk.npz", ["no file moonwalk.npz"]),
        ("env.robot.mjcf=nowhere.xml", ["env.robot.mjcf", "no file nowhere.xml"]),
        ("env.termination.distance_end_m=2.0", ["distance_end_m exceeds"]),
        ("ppo.max_learning_rate=1e-4", ["ppo.learning_rate"]),
        ("resume=maybe", ["resume is 'maybe'", "never, auto, or the directory of a run"]),
        ("device=tpu", ["device is 'tpu'", "cuda"]),
        ("ppo.hidden_sizes=[0]", ["ppo.hidden_sizes"]),
        ("+extra=1", ["there is no key extra. Allowed here: ", "seed"]),
        ("+ppo.gama=1", ["there is no key ppo.gama. Did you mean gamma? Allowed in ppo: "]),
        ("+reward.goal.base_height=1", ["reward.goal.base_height", "reward.optimizing"]),
        ("reward.goal.body_pos=nan", ["reward.goal.body_pos is nan", "finite"]),
        ("reward.parameters.body_pos.sigma=-1", ["body_pos.sigma is -1.0", "above 0"]),
        ("reward.parameters.dof_pos_limits.margin=5", ["margin is 5.0", "below 1"]),
        ("scale.name=a/b", ["scale.name is 'a/b'", "letters"]),
        (
            "reward.shaping=[action_smoothness]",
            ["action_smoothness is no cost of the state", "base"],
        ),
        ("reward.shaping=[speed]", ["reward.shaping: speed is no reward term; allowed: base"]),
        ("reward.shaping=[lin_vel_z,lin_vel_z]", ["lin_vel_z stands there twice"]),
        ("reward.ranked=all", ["reward.ranked is 'all'", "segment, episode, per_step, age_"]),
        ("device=7", ["device is '7'", "cuda"]),
    ],
)
def test_a_mistake_is_named_with_what_is_allowed(override, words):
    with pytest.raises(ConfigError) as error:
        load_settings(composed(override))
    for word in words:
        assert word in str(error.value)


def test_a_potential_needs_a_coefficient():
    with pytest.raises(ConfigError, match=r"reward\.shaping: lin_vel_z has no coefficient"):
        load_settings(composed("reward=shaping", "~reward.optimizing.lin_vel_z"))


def test_a_whole_number_may_stand_for_a_constant_of_a_term():
    settings = load_settings(composed("reward.parameters.body_rot.sigma=2"))
    assert settings.reward.parameters["body_rot"]["sigma"] == 2.0


def test_a_run_to_go_on_with_must_be_there(tmp_path):
    assert load_settings(composed(f"resume={tmp_path}")).resume == str(tmp_path)
    with pytest.raises(ConfigError, match="in_sweeps, never, auto, or the directory of a run"):
        load_settings(composed(f"resume={tmp_path}/nowhere"))


def test_several_mistakes_are_named_together():
    with pytest.raises(ConfigError) as error:
        load_settings(composed("seed=-1", "ppo.gamma=2"))
    assert len(str(error.value).splitlines()) == 2


def test_mistakes_stand_in_an_order_that_does_not_change():
    twice = ["body_pos", "body_rot", "joint_pos", "joint_vel", "body_lin_vel", "feet_pos"]
    reward = RewardSettings(**vars(load_settings(composed()).reward))
    reward.goal = dict.fromkeys(twice, 1.0)
    reward.optimizing = dict.fromkeys(twice, 1.0)
    told = [line.split()[0] for line in _reward_problems(reward) if "stands in" in line]
    assert told == [f"reward.goal.{name}" for name in sorted(twice)]


def test_the_two_arms_of_a_study_differ_in_the_optimizer_alone():
    static, two_layered = (plain_config(composed(f"optimizer={o}")) for o in ("fixed", "gwo"))
    assert static.pop("optimizer") != two_layered.pop("optimizer")
    assert static == two_layered


def test_runs_of_earlier_versions_can_be_read():
    """Keys that came later are filled in; what a run says itself is kept."""
    config = plain_config(composed("reward.penalty_scale=0.5"))
    assert load_settings(of_any_version(config)).reward.penalty_scale == 0.5
    del config["reward"]["penalty_scale"]
    with pytest.raises(ConfigError, match="penalty_scale"):
        load_settings(config)
    assert load_settings(of_any_version(config)).reward.penalty_scale == 1.0
    assert "penalty_scale" not in config["reward"]
