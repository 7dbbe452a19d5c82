"""The words of --disturb: which settings they mean, and what is refused."""

import pytest

from tlr_exp.assembly.environment import undisturbed
from tlr_exp.errors import UserError
from tlr_exp.evaluation.conditions import NAMES, UNDISTURBED, conditions


def applied(settings_of, text):
    condition = conditions([text])[-1]
    return condition.applied(undisturbed(settings_of().env))


def test_the_first_condition_is_none_and_each_value_is_one_of_its_own(settings_of):
    found = conditions(["push=0.5", "delay=20ms,40", "mass=1.1+friction=0.5,0.25", "push=0.5"])
    assert [condition.label for condition in found] == [
        *("none", "push=0.5", "delay=20ms", "delay=40ms"),
        *("friction=0.5+mass=1.1", "friction=0.25+mass=1.1"),
    ]
    assert [condition.file_part for condition in found][:3] == ["", "push-0.5", "delay-20ms"]
    assert found[-1].file_part == "friction-0.25-mass-1.1"
    env = undisturbed(settings_of().env)
    assert UNDISTURBED.applied(env) == env
    assert conditions([]) == [UNDISTURBED]


def test_the_order_of_what_happens_together_makes_no_other_condition():
    (_, condition) = conditions(["kp=0.8+mass=1.1", "mass=1.1+kp=0.8"])
    assert condition.label == "mass=1.1+kp=0.8"
    (_, pushed) = conditions(["push_every=2+push=1", "push=1+push_every=2.0s"])
    assert dict(pushed.changes)["disturbance.push_every_s"] == [2.0, 2.0]


def test_values_that_differ_in_any_digit_are_conditions_and_files_of_their_own():
    texts = ["push=0.1234567", "push=0.123457", "mass=1e20", "mass=1e-20", "mass=20.0", "mass=20"]
    found = conditions(texts)[1:]
    assert [condition.label for condition in found] == [
        *("push=0.1234567", "push=0.123457", "mass=1e20", "mass=1e-20", "mass=20"),
    ]
    assert len({condition.file_part for condition in found}) == len(found)


@pytest.mark.parametrize(
    ("text", "key", "value"),
    [
        ("push=0.5m/s", "push_m_s", [0.5, 0.5]),
        ("push=0.5", "push_every_s", [1.0, 3.0]),
        ("push=0.5+push_every=2s", "push_every_s", [2.0, 2.0]),
        ("delay=40", "delay_steps", [2, 2]),
        ("friction=0.3", "friction", [0.3, 0.3]),
        ("mass=1.1", "mass", [1.1, 1.1]),
        ("com=0.05m", "com_m", [0.05, 0.05]),
        ("kp=0.8", "kp", [0.8, 0.8]),
        ("kd=0", "kd", [0.0, 0.0]),
        ("armature=2", "armature", [2.0, 2.0]),
    ],
)
def test_a_number_is_a_range_without_width(settings_of, text, key, value):
    assert getattr(applied(settings_of, text).disturbance, key) == value


def test_noise_is_a_choice_and_starts_are_half_widths(settings_of):
    env = applied(settings_of, "noise=asap+start_joint_pos=0.1rad+start_root_lin_vel=0.2")
    assert env.noise == settings_of("env/noise=asap").env.noise
    assert env.reset_noise.joint_pos_rad == 0.1
    assert env.reset_noise.root_lin_vel == 0.2
    assert env.reset_noise.root_pos_m == 0.0


def test_what_a_run_was_trained_with_is_left_out(settings_of):
    trained = settings_of("env/disturbance=beyondmimic", "env/noise=asap").env
    env = conditions(["mass=1.1"])[1].applied(undisturbed(trained))
    assert env.disturbance.friction is None
    assert env.disturbance.push_m_s is None
    assert env.noise.gyro == 0.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("pusch=0.5", "'pusch=0.5' is no disturbance; allowed: NAME=VALUE"),
        ("push", "'push' is no disturbance"),
        ("push=hard", "push is 'hard'; allowed: a finite number, in m/s"),
        ("push=0.5s", "push is '0.5s'; allowed: a finite number, in m/s"),
        ("push=-1", "env.disturbance.push_m_s is -1.0; allowed: at least 0"),
        ("mass=0", "env.disturbance.mass is 0.0; allowed: above 0"),
        ("friction=nan", "friction is 'nan'; allowed: a finite number$"),
        ("delay=20,inf", "delay is 'inf'; allowed: a finite number, in ms"),
        ("delay=nan", "delay is 'nan'; allowed: a finite number, in ms"),
        ("push=-infm/s", "push is '-infm/s'; allowed: a finite number, in m/s"),
        ("start_root_pos=1e999", "start_root_pos is '1e999'; allowed: a finite number, in m"),
        ("delay=30", "a delay is whole control steps of 20 ms"),
        ("delay=-20", "env.disturbance.delay_steps is -1; allowed: from 0 to 50"),
        ("noise=loud", "noise=loud; allowed: asap, beyondmimic, none"),
        ("mass=1.1+mass=1.2", "a name stands in it twice"),
        ("push_every=2", "push_every needs push"),
        ("start_root_rot=4", "env.reset_noise.root_rot_rad is 4.0; allowed: from 0 to 3.14159"),
        ("mass=", "mass is ''; allowed: a finite number"),
    ],
)
def test_what_cannot_be_is_refused_with_what_can(text, words):
    with pytest.raises(UserError, match=words):
        conditions([text])


def test_every_name_is_explained(tmp_path):
    from pathlib import Path

    page = (Path(__file__).parents[2] / "docs" / "disturbances.md").read_text(encoding="utf-8")
    for name in NAMES:
        assert f"`{name}" in page, name
