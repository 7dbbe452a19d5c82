"""Figures 6, 7, 8, 13, 14, 15 and Table 1 against values worked by hand."""

import numpy as np
import pytest
from hand_values import flat_study, line_of, texts_of, with_values, without
from studies import make_study

from analysis.figures.drawing import NotDrawnError
from analysis.figures.improvement import figure_8
from analysis.figures.tracking import figure_6, figure_7, figure_13
from analysis.figures.wall_clock import figure_15
from analysis.figures.weights import figure_14
from tlr_exp import keys

STATIC, LAYERED = "static", "two-layered (GWO)"
UPPER, LOWER = keys.TRAIN_UPPER_BODY_ERROR, keys.TRAIN_LOWER_BODY_ERROR


@pytest.fixture(scope="module")
def study():
    """Two seeds, four iterations; the errors of seed 1 are 0.1 m above those of seed 0."""
    study = flat_study()
    study = with_values(
        study, keys.EPISODE_LENGTH, fixed=[[10], [20]], gwo=[[30, 30, 30, 50], [50] * 4]
    )
    study = with_values(
        study, UPPER, fixed=[[0.2], [0.3]], gwo=[[0.1, 0.1, 0.2, 0.2], [0.2, 0.2, 0.3, 0.4]]
    )
    return with_values(study, LOWER, fixed=[[0.1], [0.2]], gwo=[[0.2], [0.3]])


def test_figure_6_is_the_mean_over_seeds(study):
    drawn = figure_6(study)
    (axes,) = drawn.figure.axes
    assert line_of(axes, STATIC).tolist() == [[1, 2, 3, 4], [15, 15, 15, 15]]
    assert line_of(axes, LAYERED)[1] == pytest.approx([40, 40, 40, 50])
    assert len(axes.collections) == 2
    assert axes.get_ylabel() == "Episode length (control steps)"
    assert axes.get_xlabel() == "PPO iteration"
    assert "0.02 s" in drawn.caption
    assert "n = 2 seeds per arm (0, 1)" in drawn.caption
    assert "demo: 8 environments" in drawn.caption
    assert drawn.stem == "figure_06_episode_length"


def test_figure_7_is_one_run_per_arm(study):
    drawn = figure_7(study)
    upper, lower = drawn.figure.axes
    assert line_of(upper, STATIC)[1] == pytest.approx([0.2] * 4)
    assert line_of(upper, LAYERED)[1] == pytest.approx([0.1, 0.1, 0.2, 0.2])
    assert line_of(lower, LAYERED)[1] == pytest.approx([0.2] * 4)
    assert upper.get_ylabel() == "Upper-body error (m)"
    assert lower.get_ylabel() == "Lower-body error (m)"
    assert len(upper.collections) == 0
    assert "seed 0" in drawn.caption
    assert "No band" in drawn.caption


def test_figure_13_is_all_seeds_with_bands(study):
    drawn = figure_13(study)
    upper, lower = drawn.figure.axes
    assert line_of(upper, STATIC)[1] == pytest.approx([0.25] * 4)
    assert line_of(upper, LAYERED)[1] == pytest.approx([0.15, 0.15, 0.25, 0.3])
    spread = 0.1 / np.sqrt(2)  # standard deviation of two values 0.1 apart
    vertices = lower.collections[0].get_paths()[0].vertices
    assert vertices[:, 1].min() == pytest.approx(0.15 - spread)
    assert vertices[:, 1].max() == pytest.approx(0.15 + spread)
    assert "mean ± 1 standard deviation between seeds" in drawn.caption


def test_figure_8_is_the_improvement_of_the_averaged_curves(study):
    """Upper body: averaged 0.25 against 0.15, 0.15, 0.25, 0.30: 40, 40, 0 and -20 %; average 15 %.

    Lower body: 0.15 against 0.25: -66.7 %. Seed 0 alone: (50 + 50 + 0 + 0) / 4 = 25 % and -100 %.
    """
    drawn = figure_8(study)
    upper, lower = drawn.figure.axes
    assert line_of(upper, LAYERED)[1] == pytest.approx([40, 40, 0, -20])
    assert line_of(lower, LAYERED)[1] == pytest.approx([-200 / 3] * 4)
    heights = [line.get_ydata()[0] for line in upper.lines if len(line.get_ydata()) == 2]
    assert any(height == pytest.approx(15) for height in heights)
    assert "+15.0 %" in texts_of(drawn.figure)
    assert "upper body, two-layered (GWO): +15.0 % (seed 0 alone: +25.0 %)" in drawn.caption
    assert "66.7 % (seed 0 alone: " in drawn.caption
    assert upper.get_ylabel() == "Improvement over static (%)"


def test_figure_8_needs_two_arms_and_a_positive_baseline(study):
    with pytest.raises(NotDrawnError, match="one arm alone, 'gwo'"):
        figure_8(flat_study(arms=["gwo"]))
    with pytest.raises(NotDrawnError, match="positive baseline"):
        figure_8(with_values(study, UPPER, fixed=0.0))


def test_figure_14_shows_every_term_with_final_value_and_mean():
    study = with_values(
        flat_study(), "weight/ang_vel_xy", gwo=[[1, 0.5, 0.2, 0.8], [0, 0.5, 0.4, 1]]
    )
    drawn = figure_14(study)
    titles = [axes.get_title(loc="left") for axes in drawn.figure.axes]
    assert len([title for title in titles if title]) == 6
    # Means over seeds 0.5, 0.5, 0.3, 0.9: final 0.90, mean 0.55.
    assert "ang_vel_xy: final 0.90, mean 0.55" in titles
    panel = drawn.figure.axes[titles.index("ang_vel_xy: final 0.90, mean 0.55")]
    assert any(line.get_ydata() == pytest.approx([0.5, 0.5, 0.3, 0.9]) for line in panel.lines)
    assert "its weights never change: static" in drawn.caption
    assert "Weight (no unit)" in texts_of(drawn.figure)


def test_figure_14_states_its_smoothing():
    caption = figure_14(make_study(np.random.default_rng(0), iterations=100)).caption
    assert "centred moving average over 5 iterations" in caption
    assert "Smoothing: none." in figure_14(flat_study()).caption


def test_figure_14_of_several_arms_is_a_grid():
    study = make_study(np.random.default_rng(0), ["fixed", "gwo", "random"], [0], 10)
    drawn = figure_14(study)
    assert len(drawn.figure.axes) == 6 * 2
    assert "random weights" in drawn.figure.axes[1].get_title(loc="left")


def test_figure_14_keeps_weights_above_one_in_sight():
    study = with_values(flat_study(), "weight/base_height", gwo=[[0, 1, 2, 2.5], [0, 1, 2, 2.5]])
    for axes in figure_14(study).figure.axes:
        assert axes.get_ylim()[1] > 2.5


def test_figure_14_without_weights_that_change():
    with pytest.raises(NotDrawnError, match="no arm changes its weights"):
        figure_14(flat_study(arms=["fixed"]))
    study = flat_study()
    names = [name for name in study.metric_names if name.startswith(keys.WEIGHT_PREFIX)]
    with pytest.raises(NotDrawnError, match="begins with weight/"):
        figure_14(without(study, *names))


def test_figure_15_is_seconds_and_share_without_the_evaluation():
    """0.5 s of an iteration of 7 s, of which 2 s are the evaluation: 10 %."""
    study = with_values(flat_study(seeds=[0]), "time/weights_s", fixed=0.001, gwo=0.5)
    study = with_values(study, "time/iteration_s", fixed=[5, 5, 7, 7], gwo=[5, 5, 7, 7])
    none = np.nan
    study = with_values(study, "time/evaluate_s", fixed=[none, none, 2, 2], gwo=[none, none, 2, 2])
    drawn = figure_15(study)
    seconds, share = drawn.figure.axes
    assert line_of(seconds, LAYERED)[1] == pytest.approx([0.5] * 4)
    assert line_of(share, LAYERED)[1] == pytest.approx([10.0] * 4)
    assert line_of(share, STATIC)[1] == pytest.approx([0.02] * 4)
    assert seconds.get_ylabel() == "Weight search per iteration (s)"
    assert share.get_ylabel() == "Share of the iteration (%)"
    assert "two-layered (GWO) 0.5 s (10 %)" in drawn.caption


def test_figure_15_needs_times():
    with pytest.raises(NotDrawnError, match="time/iteration_s"):
        figure_15(without(flat_study(), "time/iteration_s"))
