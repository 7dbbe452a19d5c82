"""Figures beyond the paper against hand arithmetic and the statistics that they show."""

import numpy as np
import pytest
from hand_values import flat_study, line_of, texts_of, with_values, without
from studies import make_study

from analysis.figures.curve_comparison import (
    figure_autocorrelation,
    figure_curve_comparison,
    runs_of,
)
from analysis.figures.drawing import NotDrawnError
from analysis.figures.false_positives import false_positive_plot, figure_false_positives
from analysis.figures.forest import ForestRow, figure_forest, forest_plot
from analysis.figures.seeds import figure_profile, figure_seeds, profile
from analysis.figures.wall_clock import figure_wall_clock, wall_clock_split
from analysis.figures.weights import figure_optimum
from analysis.statistics.comparison import compare
from analysis.statistics.curves import compare_curves
from analysis.statistics.nulls import FalsePositiveRates
from tlr_exp import keys

LAYERED = "two-layered (GWO)"
UPPER = keys.TRAIN_UPPER_BODY_ERROR


@pytest.fixture(scope="module")
def five_seeds():
    return make_study(np.random.default_rng(1), iterations=40, effect=0.3)


# --- seeds -----------------------------------------------------------------------------------
def test_every_run_has_a_line_of_its_own():
    study = with_values(flat_study(), UPPER, gwo=[[1, 2, 3, 4], [5, 6, 7, 8]])
    drawn = figure_seeds(study)
    panels = {axes.get_title(loc="left"): axes for axes in drawn.figure.axes}
    assert line_of(panels["Upper body, seed 0"], LAYERED)[1].tolist() == [1, 2, 3, 4]
    assert line_of(panels["Upper body, seed 1"], LAYERED)[1].tolist() == [5, 6, 7, 8]
    assert len(panels) == 4


def test_a_seed_alone_is_figure_7():
    with pytest.raises(NotDrawnError, match="Figure 7"):
        figure_seeds(flat_study(seeds=[0]))


def test_twelve_seeds_wrap():
    drawn = figure_seeds(flat_study(seeds=range(12)))
    shown = [axes for axes in drawn.figure.axes if axes.get_visible()]
    assert len(shown) == 24


def test_profile_by_hand():
    """Of 1, 2, 2, 4 a quarter is at most 1, three quarters at most 2, all at most 4."""
    at, share = profile(np.array([2.0, 4.0, 1.0, 2.0]), larger_is_better=False)
    assert at.tolist() == [1, 2, 2, 4]
    assert share.tolist() == [0.25, 0.75, 0.75, 1.0]
    _, share = profile(np.array([2.0, 4.0, 1.0, 2.0]), larger_is_better=True)
    assert share.tolist() == [1.0, 0.75, 0.75, 0.25]


def test_profile_is_of_the_last_fifth():
    """Of ten iterations the last two count: means 2.5 and 7.5."""
    values = np.zeros((2, 10))
    values[:, -2:] = [[2, 3], [7, 8]]
    study = with_values(flat_study(iterations=10), keys.EPISODE_LENGTH, gwo=values, fixed=1)
    panel = figure_profile(study).figure.axes[2]
    x, y = line_of(panel, LAYERED)
    assert x[1:-1].tolist() == [2.5, 7.5]
    assert y.tolist() == [1, 1, 0.5, 0]
    assert "control steps" in panel.get_xlabel()


def test_profile_needs_seeds():
    with pytest.raises(NotDrawnError, match="no distribution"):
        figure_profile(flat_study(seeds=[1]))


# --- the weight search and the clock ---------------------------------------------------------
def test_optimum_is_in_per_cent_and_j_is_not():
    study = with_values(flat_study(seeds=[0]), keys.BOX_OPTIMAL_SHARE, gwo=0.25, fixed=0)
    study = with_values(study, keys.OBJECTIVE_AFTER, gwo=0, fixed=3)
    axes = figure_optimum(study).figure.axes
    assert line_of(axes[1], LAYERED)[1].tolist() == [25] * 4
    assert line_of(axes[3], LAYERED)[1].tolist() == [0] * 4
    assert axes[3].get_ylim()[0] < 0  # a curve on 0 is seen whole
    assert axes[3].get_yscale() == "symlog"


def test_optimum_leaves_out_what_older_runs_lack():
    study = without(flat_study(), keys.BOX_OPTIMAL_SHARE)
    shown = [axes for axes in figure_optimum(study).figure.axes if axes.get_visible()]
    assert len(shown) == 3
    names = (keys.OPTIMAL_SHARE, keys.OBJECTIVE_BEFORE, keys.OBJECTIVE_AFTER)
    with pytest.raises(NotDrawnError, match="train/optimal_share"):
        figure_optimum(without(study, *names))


def timed_study():
    """An evaluation of 4 s in one of four iterations, so 1 s in the mean; 2 s are not accounted."""
    study = flat_study(seeds=[0, 1])
    seconds = {"collect": 1.0, "weights": 0.5, "advantage": 0.25, "update": 3.0, "landscape": 0.25}
    for phase, value in seconds.items():
        study = with_values(study, f"time/{phase}_s", gwo=value)
    study = with_values(study, "time/evaluate_s", gwo=[np.nan, np.nan, np.nan, 4.0])
    return with_values(study, "time/iteration_s", gwo=[[7.0] * 3 + [9.0], [7.0] * 3 + [13.0]])


def test_wall_clock_by_hand():
    """Iterations of 7.5 s and 8.5 s in the mean: 8 s, of which the phases take 6 s."""
    split = wall_clock_split(timed_study(), "gwo")
    assert split.seconds["evaluate"] == pytest.approx(1.0)
    assert split.seconds["other"] == pytest.approx(2.0)
    assert split.total == pytest.approx(8.0)
    assert split.per_seed == pytest.approx([7.5, 8.5])


def test_wall_clock_bars_add_up():
    (axes,) = figure_wall_clock(timed_study()).figure.axes
    second = [bar for bar in axes.patches if bar.get_y() > 0.5]
    assert sum(bar.get_width() for bar in second) == pytest.approx(8.0)
    assert "8.00 ± 0.71 s" in texts_of(axes.figure)
    assert "(s)" in axes.get_xlabel()


def test_wall_clock_needs_times():
    with pytest.raises(NotDrawnError, match="time/iteration_s"):
        figure_wall_clock(without(flat_study(), "time/iteration_s"))


# --- statistics ------------------------------------------------------------------------------
def test_forest_shows_the_intervals_of_the_comparison(five_seeds):
    generator = np.random.default_rng(0)
    baseline, treatment = np.array([1.0, 1.1, 0.9]), np.array([0.8, 0.7, 0.9])
    result = compare(baseline, treatment, smaller_is_better=True, generator=generator)
    drawn = forest_plot([ForestRow("Error", "m", "gwo", result)], five_seeds)
    (axes,) = drawn.figure.axes
    interval = result.relative_improvement
    spans = [line.get_xdata() for line in axes.lines if len(line.get_xdata()) == 2]
    assert any(span == pytest.approx([100 * interval.low, 100 * interval.high]) for span in spans)
    points = [line.get_xdata()[0] for line in axes.lines if len(line.get_xdata()) == 1]
    assert points == pytest.approx([20.0])  # 1 - 0.8 / 1
    assert "0.200 [" in texts_of(drawn.figure)
    assert "m, p = 0.2" in texts_of(drawn.figure)  # 2 / 20 labelings at 0.1 at the least


def test_forest_of_a_study_has_training_and_evaluation(five_seeds):
    labels = [
        text.get_text() for text in figure_forest(five_seeds).figure.axes[0].get_yticklabels()
    ]
    assert labels[:3] == ["Episode length", "Upper-body error", "Lower-body error"]
    assert "Survival, evaluation" in labels
    assert "Joint error, evaluation" not in labels  # synthetic studies have none


def test_forest_of_one_seed_has_points_without_intervals():
    drawn = figure_forest(flat_study(seeds=[0], iterations=10))
    assert "No intervals: " in drawn.caption
    assert not any(line.get_marker() == "|" for line in drawn.figure.axes[0].lines)


def test_curve_comparison_shows_the_band_of_the_permutations(five_seeds):
    drawn = figure_curve_comparison(five_seeds)
    axes = drawn.figure.axes[0]
    curves = [five_seeds.matrix(UPPER, arm)[2] for arm in ("fixed", "gwo")]
    result = compare_curves(*curves, generator=np.random.default_rng(0))
    assert line_of(axes, LAYERED)[1] == pytest.approx(result.difference)
    vertices = axes.collections[0].get_paths()[0].vertices
    assert vertices[:, 1].max() == pytest.approx(result.margin.max())
    assert result.differs.any()  # a true difference of 30 %
    spans = [patch for patch in axes.patches if patch.get_visible()]
    width = sum(patch.get_width() for patch in spans)
    assert width == pytest.approx(result.differs.sum())
    assert "252 labelings" in drawn.caption
    assert f"p = {result.p_value:.2g}" in axes.get_title(loc="left")


def test_curve_comparison_says_when_seeds_are_too_few():
    drawn = figure_curve_comparison(
        make_study(np.random.default_rng(0), seeds=range(3), iterations=8)
    )
    assert "cannot give a p below 0.1" in drawn.caption
    with pytest.raises(NotDrawnError, match="one seed: static"):
        figure_curve_comparison(flat_study(seeds=[0]))


def test_runs_of_flags():
    flags = np.array([True, True, False, False, True, False, True])
    assert runs_of(flags) == [(0, 1), (4, 4), (6, 6)]
    assert runs_of(np.zeros(3, bool)) == []


def test_autocorrelation_of_a_difference_by_hand():
    """Differences 1, -1, 1, -1 (mean 0): rho_1 = (-1 - 1 - 1) / 4."""
    study = with_values(flat_study(seeds=[0]), UPPER, fixed=3, gwo=[4, 2, 4, 2])
    study = with_values(study, keys.TRAIN_LOWER_BODY_ERROR, fixed=3, gwo=[4, 4, 2, 2])
    axes = figure_autocorrelation(study).figure.axes
    assert line_of(axes[0], LAYERED).tolist() == [[0, 1], [1, pytest.approx(-0.75)]]
    assert line_of(axes[1], LAYERED)[1] == pytest.approx([1, 0.25])
    assert axes[0].get_xlabel() == "Lag (iterations)"
    assert "effective sample size" in texts_of(axes[0].figure)


def test_autocorrelation_of_a_constant_difference():
    study = with_values(flat_study(seeds=[0]), UPPER, fixed=3, gwo=4)
    with pytest.raises(NotDrawnError, match="constant"):
        figure_autocorrelation(study)


def rates(**changed) -> FalsePositiveRates:
    values = {
        "iteration_t": 0.95,
        "iteration_t_extreme": 0.88,
        "welch": 0.043,
        "permutation": 0.038,
        "alpha": 0.05,
        "num_studies": 1000,
        "num_seeds": (5, 5),
        "num_iterations": 407,
    }
    return FalsePositiveRates(**(values | changed))


def test_false_positive_bars(five_seeds):
    drawn = false_positive_plot({"simulated": rates()}, five_seeds)
    heights = [bar.get_height() for bar in drawn.figure.axes[0].patches]
    assert heights == pytest.approx([95, 88, 4.3, 3.8])
    assert "simulated: 1000 cases of 5 against 5 seeds, 407 iterations" in drawn.caption
    assert "what it should be: 5 %" in texts_of(drawn.figure)


def test_false_positives_of_the_seeds_of_each_arm(five_seeds):
    both = {keys.TRAIN_UPPER_BODY_ERROR: rates(), keys.TRAIN_LOWER_BODY_ERROR: rates()}
    drawn = figure_false_positives(five_seeds, simulated=both)
    assert len(drawn.figure.axes[0].patches) == 4 * 4
    assert "simulated studies, lower-body error: 1000 cases" in drawn.caption
    assert "seeds of static: 10 cases of 2 against 3 seeds" in drawn.caption
    with pytest.raises(NotDrawnError, match="4 seeds"):
        figure_false_positives(flat_study(seeds=range(3)))
    assert figure_false_positives(flat_study(seeds=range(3)), both).stem == "false_positives"
