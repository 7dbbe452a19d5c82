"""All figures in the cases that studies come in."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hand_values import texts_of
from matplotlib.backends.backend_agg import FigureCanvasAgg
from studies import make_study, with_starts

from analysis.figures.catalogue import ALL_FIGURES
from analysis.figures.drawing import Drawing, NotDrawnError
from analysis.figures.style import render
from tlr_exp import keys

SIX_ARMS = ["fixed", "gwo", "random", *(f"gwo, threshold_share={s}" for s in (0.02, 0.2, 0.5))]
SWEPT_ARMS = ["fixed", "gwo, threshold_share=0.02", "gwo, threshold_share=0.5"]
NEEDS_A_SWEEP = {"trend"}
NEEDS_ROLL_OUTS = {"tradeoff"}  # with the terms of the lower layer
ONE_RUN_HAS_NO = {"seed_lines", "performance_profile", "curve_comparison", "false_positives"}


def draw(spec, study) -> Drawing | str:
    try:
        return spec.draw(study)
    except NotDrawnError as reason:
        return str(reason)


def demo_for(spec):
    arms = SWEPT_ARMS if spec.stem in NEEDS_A_SWEEP else ["fixed", "gwo"]
    study = make_study(np.random.default_rng(0), arms, iterations=24)
    return with_starts(study, np.random.default_rng(1)) if spec.stem in NEEDS_ROLL_OUTS else study


@pytest.fixture(scope="module")
def demo():
    return make_study(np.random.default_rng(0), iterations=24)


@pytest.fixture(scope="module")
def drawings():
    return {spec.stem: spec.draw(demo_for(spec)) for spec in ALL_FIGURES}


def unfinished(demo):
    curves = demo.curves[(demo.curves["seed"] != 1) | (demo.curves["iteration"] < 9)]
    return replace(demo, curves=curves, runs=demo.runs.assign(status="interrupted"))


def test_the_list_has_every_figure_once():
    stems = [spec.stem for spec in ALL_FIGURES]
    assert len(set(stems)) == len(stems) == 16
    papers = [spec.paper for spec in ALL_FIGURES if spec.paper]
    assert papers == [f"Figure {number}" for number in (6, 7, 8, 13, 14, 15)]


@pytest.mark.parametrize("spec", ALL_FIGURES, ids=lambda spec: spec.stem)
def test_a_demo_study_has_every_figure(spec, drawings):
    drawing = drawings[spec.stem]
    assert drawing.stem == spec.stem
    seeds = "n = 1 seed per arm (0)" if spec.paper == "Figure 7" else "n = 5 seeds per arm (0 to 4)"
    assert seeds in drawing.caption
    assert "demo: 8 environments" in drawing.caption
    assert "24 iterations" in drawing.caption
    assert "Smoothing: " in drawing.caption
    assert drawing.title
    assert not drawing.title.endswith(".")
    assert "nan" not in texts_of(drawing.figure).lower()


@pytest.mark.parametrize("spec", ALL_FIGURES, ids=lambda spec: spec.stem)
def test_identical_data_give_identical_files(spec, drawings):
    first = render(drawings[spec.stem].figure, "svg")
    assert first == render(spec.draw(demo_for(spec)).figure, "svg")


@pytest.mark.parametrize("spec", ALL_FIGURES, ids=lambda spec: spec.stem)
def test_nothing_is_cut_off(spec, drawings):
    """Every panel with its labels lies within the figure, and on no other panel."""
    figure = drawings[spec.stem].figure
    FigureCanvasAgg(figure).draw()
    boxes = [axes.get_tightbbox() for axes in figure.axes if axes.get_visible()]
    width, height = figure.bbox.size
    for box in boxes:
        assert min(box.x0, box.y0) >= -1
        assert box.x1 <= width + 1
        assert box.y1 <= height + 1
    for first, second in combinations(boxes, 2):
        shared_width = min(first.x1, second.x1) - max(first.x0, second.x0)
        shared_height = min(first.y1, second.y1) - max(first.y0, second.y0)
        assert min(shared_width, shared_height) <= 2


def test_one_run_per_arm():
    study = make_study(np.random.default_rng(0), seeds=[0], iterations=24)
    drawn = {spec.stem: draw(spec, study) for spec in ALL_FIGURES}
    left_out = {stem for stem, drawing in drawn.items() if isinstance(drawing, str)}
    assert left_out == ONE_RUN_HAS_NO | NEEDS_A_SWEEP | NEEDS_ROLL_OUTS
    captions = [drawing.caption for drawing in drawn.values() if isinstance(drawing, Drawing)]
    assert not any("Lines and bands" in caption for caption in captions)


def test_six_arms():
    study = make_study(np.random.default_rng(0), arms=SIX_ARMS, seeds=[0, 1], iterations=6)
    left_out = {spec.stem for spec in ALL_FIGURES if isinstance(draw(spec, study), str)}
    assert (
        left_out == {"false_positives"} | NEEDS_ROLL_OUTS
    )  # a sweep of three values, beside two other methods


def test_one_arm_has_no_comparison():
    study = make_study(np.random.default_rng(0), arms=["gwo"], seeds=[0, 1], iterations=5)
    left_out = {spec.stem for spec in ALL_FIGURES if isinstance(draw(spec, study), str)}
    compared = {"figure_08_improvement", "forest", "curve_comparison", "autocorrelation"}
    assert left_out == compared | {"false_positives"} | NEEDS_A_SWEEP | NEEDS_ROLL_OUTS


def test_the_papers_number_of_iterations():
    study = make_study(np.random.default_rng(0), seeds=[0, 1], iterations=2500, scale="paper")
    left_out = {spec.stem for spec in ALL_FIGURES if isinstance(draw(spec, study), str)}
    assert left_out == {"false_positives"} | NEEDS_A_SWEEP | NEEDS_ROLL_OUTS


def test_one_iteration_can_be_laid_out():
    study = make_study(np.random.default_rng(0), seeds=[0, 1], iterations=1)
    for spec in ALL_FIGURES:
        drawing = draw(spec, study)
        if isinstance(drawing, Drawing):
            FigureCanvasAgg(drawing.figure).draw()


def test_unfinished_runs_have_every_figure():
    for spec in ALL_FIGURES:
        caption = spec.draw(unfinished(demo_for(spec))).caption
        assert "not finished: " in caption or spec.paper == "Figure 7", spec.stem


def test_iterations_before_the_first_episode_ends_are_left_out(demo):
    curves = demo.curves.copy()
    curves.loc[curves["iteration"] < 4, keys.EPISODE_LENGTH] = np.nan
    drawing = ALL_FIGURES[0].draw(replace(demo, curves=curves))
    assert drawing.figure.axes[0].lines[0].get_xdata()[0] == 4
