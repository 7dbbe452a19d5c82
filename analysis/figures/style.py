"""One look for all figures: colours, sizes, fonts, and files that are the same bytes every time.

Colours are those of Okabe and Ito, which people with any common colour blindness can tell apart.
Every arm also has a line style, a marker and a hatch of its own, so that a figure survives a
greyscale print. Matplotlib's global state is neither read nor changed: figures are made and saved
inside ``matplotlib.style.context``, on top of Matplotlib's own defaults.
"""

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Any, Literal, ParamSpec, TypeVar

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from analysis.data.study import pretty_arm

PAPER_COLUMN_IN = 3.4  # width of one column of a paper, inches (86 mm)
TWO_COLUMNS_IN = 7.0  # width of both columns, inches (178 mm)
PNG_DPI = 200

MINUS, TIMES = "\N{MINUS SIGN}", "\N{MULTIPLICATION SIGN}"  # as in the ticks of the axes

BLACK = "#000000"
ORANGE = "#E69F00"
SKY_BLUE = "#56B4E9"
GREEN = "#009E73"
BLUE = "#0072B2"
VERMILLION = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#666666"
GRID_GREY = "#D9D9D9"

STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",  # comes with Matplotlib, so every machine has the same
    "font.size": 7.5,
    "axes.titlesize": 8.0,
    "axes.labelsize": 7.5,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "legend.handlelength": 2.6,
    "legend.columnspacing": 1.4,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID_GREY,
    "grid.linewidth": 0.4,
    "lines.linewidth": 1.2,
    "lines.markersize": 4.0,
    "hatch.linewidth": 0.5,
    "hatch.color": "white",
    "axes.formatter.limits": (-4, 5),
    "path.simplify_threshold": 0.2,  # of a pixel: smaller files, no difference to be seen
    "svg.hashsalt": "tlr_exp",  # the ids inside an SVG are hashes with this salt
    "svg.fonttype": "path",  # looks the same on machines without the font
    "pdf.fonttype": 42,
}
# What each format would write that is not the figure: the time of saving.
_METADATA: dict[str, dict[str, None]] = {
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
    "png": {},
}
Format = Literal["svg", "pdf", "png"]


def darker(color: str) -> str:
    """A colour for text on white, where the pale ones of the palette are hard to read."""
    red, green, blue = (int(color[start : start + 2], 16) for start in (1, 3, 5))
    return "#" + "".join(f"{round(0.72 * part):02X}" for part in (red, green, blue))


@dataclass(frozen=True)
class ArmLook:
    """How one arm is drawn wherever it appears."""

    label: str
    color: str
    linestyle: Any
    marker: str
    hatch: str

    @property
    def line(self) -> dict[str, Any]:
        """Keyword arguments of ``Axes.plot``, without the marker's places."""
        return {
            "color": self.color,
            "linestyle": self.linestyle,
            "marker": self.marker,
            "markeredgecolor": "white",
            "markeredgewidth": 0.3,
            "label": self.label,
        }


_DASHED, _DOTTED, _DASH_DOT = (0, (5, 1.4)), (0, (1.2, 1.2)), (0, (5, 1.4, 1.2, 1.4))
_KNOWN_LOOKS = {
    "fixed": ArmLook(pretty_arm("fixed"), BLACK, _DASHED, "s", ""),
    "gwo": ArmLook(pretty_arm("gwo"), VERMILLION, "-", "o", "////"),
    "random": ArmLook(pretty_arm("random"), BLUE, _DASH_DOT, "^", "...."),
}
_OTHER_COLORS = (GREEN, PURPLE, SKY_BLUE, ORANGE, BLUE, VERMILLION, GREY)
_OTHER_MARKERS = ("D", "v", "P", "X", "<", ">", "*")
_OTHER_LINES = ("-", _DASHED, _DASH_DOT, _DOTTED)
_OTHER_HATCHES = ("\\\\\\\\", "xxxx", "----", "||||", "++++", "oooo", "****")


def arm_looks(arms: Sequence[str]) -> dict[str, ArmLook]:
    """The look of every arm of a study.

    The arms of the paper and the random control always look the same. Other arms take what is left
    in the order given, so an arm looks the same in all figures of one study. Looks repeat from the
    29th other arm on.
    """
    others = [arm for arm in arms if arm not in _KNOWN_LOOKS]
    taken = {_KNOWN_LOOKS[arm].color for arm in arms if arm in _KNOWN_LOOKS}
    colors = [color for color in _OTHER_COLORS if color not in taken]
    looks = {}
    for place, arm in enumerate(others):
        looks[arm] = ArmLook(
            label=pretty_arm(arm),
            color=colors[place % len(colors)],
            linestyle=_OTHER_LINES[place % len(_OTHER_LINES)],
            marker=_OTHER_MARKERS[place % len(_OTHER_MARKERS)],
            hatch=_OTHER_HATCHES[place % len(_OTHER_HATCHES)],
        )
    return {arm: looks[arm] if arm in looks else _KNOWN_LOOKS[arm] for arm in arms}


_P = ParamSpec("_P")
_R = TypeVar("_R")


def styled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Run a drawing function under the look of this module, whatever the user's matplotlibrc."""

    @wraps(function)
    def wrapper(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        with style.context(["default", STYLE]):
            return function(*args, **kwargs)

    return wrapper


def new_figure(
    width_in: float, height_in: float, rows: int = 1, columns: int = 1, **subplots: Any
) -> tuple[Figure, np.ndarray]:
    """An empty figure that belongs to no window; axes as an object array [rows, columns]."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False, **subplots)


def legend_above(figure: Figure, handles: Sequence[Any], columns: int | None = None) -> None:
    """A compact legend above all panels, where it can cover no data."""
    if columns is None:
        columns = legend_columns([handle.get_label() for handle in handles], figure.get_figwidth())
    figure.legend(handles=handles, loc="outside upper center", ncols=columns)


def legend_columns(labels: Sequence[str], width_in: float) -> int:
    """How many columns of these labels fit on a figure of this width; at least 1."""
    handle_in, letter_in = 0.3, 0.055
    entry_in = handle_in + 0.15 + letter_in * max(len(label) for label in labels)
    return max(1, min(len(labels), int(width_in / entry_in)))


def panel_letter(axes: Axes, letter: str, title: str) -> None:
    """Title of a panel, at its left: "(a) Upper body"."""
    axes.set_title(f"({letter}) {title}", loc="left")


@styled
def settle(figure: Figure) -> None:
    """Lay a figure out for good: all its files then have everything in one place, and sooner."""
    figure.draw_without_rendering()
    figure.set_layout_engine("none")


@styled
def render(figure: Figure, file_format: Format) -> bytes:
    """The figure as the content of a file. The same figure always gives the same bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format=file_format, dpi=PNG_DPI, metadata=_METADATA[file_format])
    return buffer.getvalue()
