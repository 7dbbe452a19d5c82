"""One look for all figures, and files that are the same bytes every time."""

import subprocess
import sys

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from analysis.figures import style

OKABE_ITO = {
    *("#000000", "#E69F00", "#56B4E9", "#009E73", "#F0E442", "#0072B2", "#D55E00", "#CC79A7"),
}


def small_figure(title: str = "a"):
    @style.styled
    def draw():
        figure, axes = style.new_figure(2.0, 1.5)
        axes[0, 0].plot([0, 1, 2], [1, 0, 2], marker="o")
        axes[0, 0].fill_between([0, 1, 2], [0, 0, 1], [1, 1, 2], alpha=0.3, hatch="//")
        axes[0, 0].set_title(title)
        return figure

    return draw()


@pytest.mark.parametrize("file_format", ["svg", "png", "pdf"])
def test_the_same_figure_is_the_same_bytes(file_format):
    first = style.render(small_figure(), file_format)
    assert first == style.render(small_figure(), file_format)
    assert first != style.render(small_figure("b"), file_format)


def test_vector_files_hold_no_date():
    assert b"dc:date" not in style.render(small_figure(), "svg")
    assert b"CreationDate" not in style.render(small_figure(), "pdf")


def test_the_users_settings_neither_matter_nor_change():
    expected = style.render(small_figure(), "svg")
    with matplotlib.rc_context({"font.size": 30.0, "axes.grid": False, "svg.hashsalt": "x"}):
        before = dict(matplotlib.rcParams)
        assert style.render(small_figure(), "svg") == expected
        assert dict(matplotlib.rcParams) == before


def test_no_window_system_is_touched():
    code = (
        "import sys, analysis.figures.catalogue; assert 'matplotlib.pyplot' not in sys.modules, 1"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_known_arms_always_look_the_same():
    alone = style.arm_looks(["fixed", "gwo"])
    among = style.arm_looks(["random", "cma_es", "gwo", "gwo, threshold_share=0.2", "fixed"])
    assert alone["gwo"] == among["gwo"]
    assert alone["fixed"] == among["fixed"]
    assert alone["gwo"].label == "two-layered (GWO)"
    assert among["gwo, threshold_share=0.2"].label == "two-layered (GWO), threshold_share=0.2"
    assert list(among) == ["random", "cma_es", "gwo", "gwo, threshold_share=0.2", "fixed"]


def test_arms_differ_in_colour_and_without_it():
    arms = ["fixed", "gwo", "random", "cma_es", "gwo, a=1", "gwo, a=2", "gwo, a=3"]
    looks = list(style.arm_looks(arms).values())
    assert len({look.color for look in looks}) == len(arms)
    assert len({look.marker for look in looks}) == len(arms)
    assert len({look.hatch for look in looks}) == len(arms)
    assert {look.color for look in looks} <= OKABE_ITO | {style.GREY}


def test_many_arms_still_differ():
    looks = style.arm_looks([f"arm {number}" for number in range(28)]).values()
    assert len({(look.color, str(look.linestyle)) for look in looks}) == 28


@pytest.mark.parametrize("color", sorted(OKABE_ITO - {"#000000", "#F0E442"}))
def test_darker_colours_can_be_read_on_white(color):
    """Contrast against white of at least 2.9 : 1 (WCAG 2 asks 3 : 1 of large text)."""
    linear = [
        c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4
        for c in to_rgb(style.darker(color))
    ]
    luminance = float(np.dot(linear, [0.2126, 0.7152, 0.0722]))
    assert 1.05 / (luminance + 0.05) > 2.9


def test_legend_columns_fit_the_width():
    assert style.legend_columns(["static", "two-layered (GWO)"], 7.0) == 2
    assert style.legend_columns(["a" * 200, "b"], 3.4) == 1
    many = style.legend_columns(["two-layered (GWO), threshold_share=0.02"] * 6, 7.0)
    assert many == 2
