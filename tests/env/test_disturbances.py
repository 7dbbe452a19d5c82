"""What happens to robots: each disturbance against its setting, by robot and by episode."""

import io
import math

import pytest
import torch

from tlr_exp import keys
from tlr_exp.env.disturbances import Disturber, check_engine
from tlr_exp.errors import UserError

STILL = ("env.start_phase=zero", "env.termination.distance_start_m=9")
EVERYTHING = (
    "env.disturbance.push_m_s=[0.1,0.4]",
    "env.disturbance.push_every_s=[0.1,0.3]",
    "env.disturbance.delay_steps=[0,3]",
    "env.disturbance.friction=[0.3,1.2]",
    "env.disturbance.mass=[0.9,1.1]",
    "env.disturbance.com_m=[0,0.05]",
    "env.disturbance.kp=[0.8,1.2]",
    "env.disturbance.kd=[0.8,1.2]",
    "env.disturbance.armature=[0.8,1.2]",
    "env/noise=beyondmimic",
)
OF_THE_MODEL = {
    "friction": ([0.3, 1.2], ()),
    "mass": ([0.9, 1.1], (34,)),
    "kp": ([0.8, 1.2], (23,)),
    "kd": ([0.7, 1.0], (23,)),
    "armature": ([0.5, 2.0], (23,)),
}


class Recorder:
    """An engine that notes what is asked of it."""

    control_dt = 0.02
    device = torch.device("cpu")
    disturbances = ("push_m_s", "com_m", *OF_THE_MODEL)

    def __init__(self, num_envs: int) -> None:
        self.num_envs = num_envs
        self.pushes: list[tuple[torch.Tensor, torch.Tensor]] = []
        self.varied: list[tuple[torch.Tensor, dict[str, torch.Tensor]]] = []

    def push(self, env_ids, velocity) -> None:
        self.pushes.append((env_ids, velocity))

    def vary(self, env_ids, values) -> None:
        self.varied.append((env_ids, dict(values)))


@pytest.fixture
def make(robot, settings_of):
    """``make(num_envs, **ranges)``: a disturber that has begun the episodes of all its robots."""

    def build(num_envs: int, seed: int = 0, **ranges: list) -> tuple[Disturber, Recorder]:
        settings = settings_of().env.disturbance
        for name, bounds in ranges.items():
            setattr(settings, name, bounds)
        engine = Recorder(num_envs)
        disturber = Disturber(settings, robot, engine, seed)
        disturber.begin(torch.arange(num_envs), torch.zeros(num_envs, 23))
        return disturber, engine

    return build


def play(disturber: Disturber, num_steps: int) -> None:
    targets = torch.zeros(disturber.physics.num_envs, 23)
    for _ in range(num_steps):
        disturber.deliver(targets)


# --- the model -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", OF_THE_MODEL)
def test_values_fill_their_range_evenly_for_every_robot_and_part(make, name):
    (low, high), width = OF_THE_MODEL[name]
    _, engine = make(1000, **{name: [low, high]})
    [(ids, values)] = engine.varied
    assert ids.tolist() == list(range(1000))
    assert list(values) == [name]
    drawn = values[name]
    assert drawn.shape == (1000, *width)
    middle, spread = (low + high) / 2, (high - low) / math.sqrt(12)
    assert low <= drawn.min() < low + 0.01 * (high - low)
    assert high - 0.01 * (high - low) < drawn.max() <= high
    assert drawn.mean() == pytest.approx(middle, abs=5 * spread / math.sqrt(drawn.numel()))
    assert drawn.std() == pytest.approx(spread, rel=0.05)
    if width:  # joints and bodies differ from one another
        assert torch.corrcoef(drawn[:, :2].T)[0, 1].abs() < 0.15


def test_the_centre_of_mass_moves_by_its_distance_in_any_direction(make):
    _, engine = make(4000, com_m=[0.02, 0.05])
    offset = engine.varied[0][1]["com_m"]
    distance = offset.norm(dim=1)
    assert 0.02 <= distance.min() < 0.0205
    assert 0.0495 < distance.max() <= 0.0501
    direction = offset / distance[:, None]
    assert direction.mean(dim=0).abs().max() < 0.05
    assert torch.allclose(direction.T @ direction / 4000, torch.eye(3) / 3, atol=0.03)


def test_a_range_without_width_is_one_value(make):
    _, engine = make(50, mass=[1.1, 1.1], kp=[0.5, 0.5])
    values = engine.varied[0][1]
    assert torch.allclose(values["mass"], torch.tensor(1.1))
    assert torch.equal(values["kp"], torch.full((50, 23), 0.5))


def test_only_robots_that_begin_an_episode_are_drawn_anew(make):
    disturber, engine = make(6, friction=[0.1, 1.0], delay_steps=[0, 9], **PUSHES)
    play(disturber, 7)
    before = dict(disturber.now)
    disturber.begin(torch.tensor([4, 1]), torch.ones(2, 23))
    assert engine.varied[-1][0].tolist() == [4, 1]
    for name in ("friction", "queue", "wait"):
        same = (disturber.now[name] == before[name]).flatten(1) if name == "queue" else None
        unchanged = same.all(dim=1) if same is not None else disturber.now[name] == before[name]
        assert unchanged[[0, 2, 3, 5]].all(), name
    assert not (disturber.now["friction"] == before["friction"])[[1, 4]].any()
    assert torch.equal(disturber.now["friction"][[4, 1]], engine.varied[-1][1]["friction"])


# --- pushes ----------------------------------------------------------------------------------

PUSHES = {"push_m_s": [0.2, 0.6], "push_every_s": [0.2, 0.6]}


def test_pushes_have_their_size_and_any_horizontal_direction(make):
    disturber, engine = make(200, **PUSHES)
    play(disturber, 400)
    velocity = torch.cat([each for _, each in engine.pushes])
    size = velocity.norm(dim=1)
    assert velocity[:, 2].abs().max() == 0.0
    assert 0.2 <= size.min() < 0.205
    assert 0.595 < size.max() <= 0.6001
    assert size.mean() == pytest.approx(0.4, abs=0.01)
    direction = velocity[:, :2] / size[:, None]
    assert direction.mean(dim=0).abs().max() < 0.05
    assert (direction[:, 0] * direction[:, 1]).mean().abs() < 0.03


def test_pushes_come_as_often_as_they_should(make):
    """400 steps are 8 s: at 0.4 s on average, the last one not complete, about 19 to 20 each."""
    disturber, engine = make(200, **PUSHES)
    play(disturber, 400)
    number = torch.bincount(torch.cat([ids for ids, _ in engine.pushes]), minlength=200)
    assert 19.0 < number.float().mean() < 20.5
    assert number.min() >= 13
    assert number.max() <= 40


def test_a_fixed_interval_is_kept_to_the_step(make):
    disturber, engine = make(3, push_m_s=[0.5, 0.5], push_every_s=[0.1, 0.1])
    when = []
    for step in range(21):
        count = len(engine.pushes)
        play(disturber, 1)
        when += [step] * (len(engine.pushes) - count)
    assert when == [5, 10, 15, 20]
    assert all(ids.tolist() == [0, 1, 2] for ids, _ in engine.pushes)


# --- the delay -------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [0, 1, 4])
def test_targets_come_late_by_exactly_the_delay(make, delay):
    disturber, _ = make(2, delay_steps=[delay, delay])
    disturber.begin(torch.arange(2), torch.full((2, 23), -1.0))
    came = [disturber.deliver(torch.full((2, 23), float(step)))[:, 0] for step in range(8)]
    expected = [-1.0] * delay + [float(step) for step in range(8 - delay)]
    for each, value in zip(came, expected, strict=True):
        assert each.tolist() == [value, value]


def test_delays_are_whole_steps_drawn_evenly_for_each_robot(make):
    disturber, _ = make(3000, delay_steps=[1, 3])
    counts = torch.bincount(disturber.now["delay"], minlength=5)
    assert counts[[0, 4]].sum() == 0
    assert (counts[1:4] - 1000).abs().max() < 130  # five standard deviations
    came = [disturber.deliver(torch.full((3000, 23), 1.0 + step))[:, 5] for step in range(6)]
    for step, each in enumerate(came):
        expected = (1.0 + step - disturber.now["delay"]).clamp(min=0.0)
        assert torch.equal(each, expected)


# --- in an environment -----------------------------------------------------------------------


def actions(num_steps: int, seed: int, num_envs: int = 4) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return 0.5 * torch.randn(num_steps, num_envs, 23, generator=generator)


def run(env, now, script):
    steps = []
    for action in script:
        step, now = env.step_and_maybe_reset(now.set(keys.ACTION, action))
        steps.append(step)
    return torch.stack(steps, dim=1), now


def test_without_disturbances_the_engine_s_model_is_not_touched(make_env):
    env = make_env()
    env.rollout(3)
    assert env.disturber.now == {}
    assert not env.physics._batch._expanded


def test_a_disturbed_environment_continues_bit_for_bit(make_env):
    """With everything at once, through a file, episodes ending and starting in between."""
    choices = (*EVERYTHING, "env.termination.distance_start_m=0.5")
    env = make_env(*choices)
    _, now = run(env, env.reset(), actions(15, seed=1))
    buffer = io.BytesIO()
    torch.save(env.simulation_state(), buffer)
    buffer.seek(0)
    script = actions(25, seed=2)
    expected, _ = run(env, now, script)
    assert expected["next", keys.DONE].any()
    saved = torch.load(buffer, weights_only=True)
    fresh = make_env(*choices, seed=9, noise_seed=8, disturbance_seed=7, saved=saved)
    found, _ = run(fresh, fresh.reset(), script)
    for key in found["next"].keys(True, True):
        assert torch.equal(found["next", key], expected["next", key]), key
    for name, value in env.disturber.now.items():
        assert torch.equal(fresh.disturber.now[name], value), name


def test_the_same_seed_gives_the_same_disturbances_and_another_one_others(make_env):
    script = actions(12, seed=3)
    ends = []
    for seed in (1, 1, 2):
        env = make_env(*STILL, *EVERYTHING, disturbance_seed=seed)
        run(env, env.reset(), script)
        ends.append(env.state.qpos)
    assert torch.equal(ends[0], ends[1])
    assert not torch.equal(ends[0], ends[2])


def test_disturbances_leave_starts_and_noise_as_they_are(make_env):
    plain = make_env("env/noise=asap")
    pushed = make_env("env/noise=asap", *EVERYTHING[:-1])
    first, second = plain.reset(), pushed.reset()
    assert torch.equal(plain.start_frame, pushed.start_frame)
    assert torch.equal(first[keys.OBSERVATION], second[keys.OBSERVATION])


def test_a_late_target_moves_the_joints_late(make_env):
    """Two steps late, the first two steps of a robot do not know of its actions."""
    choices = (*STILL, "env.disturbance.delay_steps=[2,2]")
    ends = []
    for action in (0.0, 1.0):
        env = make_env(*choices)
        now = env.reset()
        states = []
        for _ in range(3):
            now = env.step(now.set(keys.ACTION, torch.full((4, 23), action)))["next"]
            states.append(env.state.qpos)
        ends.append(states)
    assert torch.equal(ends[0][0], ends[1][0])
    assert torch.equal(ends[0][1], ends[1][1])
    assert not torch.equal(ends[0][2], ends[1][2])


# --- what is refused -------------------------------------------------------------------------


def test_an_engine_that_cannot_is_named_with_one_that_can(settings_of):
    class Simple:
        disturbances = ("push_m_s",)

    settings = settings_of(
        "env.disturbance.friction=[1,1]",
        "env.disturbance.kp=[1,1]",
        "env.disturbance.push_m_s=[0,1]",
        "env.disturbance.push_every_s=[1,1]",
    ).env.disturbance
    with pytest.raises(
        UserError,
        match=r"Simple cannot do env.disturbance.friction, env.disturbance.kp; physics=native can",
    ):
        check_engine(settings, Simple)
    settings.friction = settings.kp = None
    check_engine(settings, Simple)
    check_engine(settings, Simple())
