"""The pictures of docs/lower-layer.md: what J sees of real batches.

    python -m benchmarks.lower_layer

draws docs/images/lower_layer_*.png from `benchmarks/optimizers/landscapes.npz` (returns of a short
training of the static arm, 512 environments) and prints the numbers that the page quotes.
"""

import json
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure
from torch import Tensor

from analysis.figures import style
from benchmarks.optimizers.record_landscapes import ITERATIONS, PATH
from benchmarks.optimizers.searches import configured
from tlr_exp.reward.box_sample import BoxSample
from tlr_exp.reward.objectives import RankDeviation

IMAGES = Path(__file__).parents[1] / "docs" / "images"
SCALES = 10.0 ** np.arange(-3.0, 1.01, 0.125)  # of all penalties
AXIS = torch.linspace(0.0, 1.0, 101)
SEARCHES = 200
COLORS = (style.BLUE, style.VERMILLION, style.GREEN, style.PURPLE, style.ORANGE, style.SKY_BLUE)
LINES = ("-", (0, (5, 1.4)), (0, (1.2, 1.2)), (0, (5, 1.4, 1.2, 1.4)))

Batch = tuple[Tensor, Tensor]  # goal_return [num_envs], term_returns [num_envs, num_terms]


def main() -> None:
    """Draw all pictures and print what they show."""
    with np.load(PATH) as file:
        names = json.loads(str(file["about"]))["terms"]
        batches = {
            n: (torch.tensor(file[f"goal_return_{n}"]), torch.tensor(file[f"term_returns_{n}"]))
            for n in ITERATIONS
        }
    print_sizes(batches, names)
    figures = {
        "lower_layer_axes": axes_figure(batches[ITERATIONS[-1]], names),
        "lower_layer_scale": scale_figure(batches),
        "lower_layer_returned": returned_figure(batches[ITERATIONS[-1]], names),
    }
    for stem, figure in figures.items():
        (IMAGES / f"{stem}.png").write_bytes(style.render(figure, "png"))


def print_sizes(batches: dict[int, Batch], names: list[str]) -> None:
    """Spread of the goal return and of each penalty between trajectories, which decides all."""
    for iteration, (goal, terms) in batches.items():
        spreads = ", ".join(
            f"{name} {value:.4f}"
            for name, value in zip(names, terms.std(dim=0).tolist(), strict=True)
        )
        print(f"iteration {iteration}: standard deviation of r_g {goal.std():.4f}; of {spreads}")


@style.styled
def axes_figure(batch: Batch, names: list[str]) -> Figure:
    """J along each weight, all others at 0 (left) and all others at 1 (right)."""
    objective = RankDeviation(0.1).prepare(*batch)
    figure, axes = style.new_figure(style.TWO_COLUMNS_IN, 2.6, columns=2, sharey=True)
    for panel, (others, letter) in enumerate(((0.0, "a"), (1.0, "b"))):
        for index, name in enumerate(names):
            weights = torch.full((len(AXIS), len(names)), others)
            weights[:, index] = AXIS
            axes[0, panel].plot(
                AXIS,
                objective(weights),
                color=COLORS[index],
                linestyle=LINES[index % len(LINES)],
                label=name,
            )
        style.panel_letter(axes[0, panel], letter, f"all other weights {others:.0f}")
        axes[0, panel].set_xlabel("Weight (no unit)")
    axes[0, 0].set_ylabel("J (no unit)")
    style.legend_above(figure, axes[0, 0].get_lines())
    return figure


@style.styled
def scale_figure(batches: dict[int, Batch]) -> Figure:
    """Share of the box that is optimal, and J of the static reward, by the penalties' scale."""
    figure, axes = style.new_figure(style.TWO_COLUMNS_IN, 2.6, columns=2)
    for index, (iteration, (goal, terms)) in enumerate(batches.items()):
        sample = BoxSample(terms.shape[1], RankDeviation(0.1))
        static = torch.ones(1, terms.shape[1])
        shares, values = [], []
        for scale in SCALES:
            scaled = float(scale) * terms
            # Zero weights always reach J = 0, so 0 is the minimum.
            shares.append(sample.optimal_share(goal, scaled, found=0.0))
            values.append(RankDeviation(0.1).prepare(goal, scaled)(static).item())
        look = {
            "color": COLORS[index],
            "linestyle": LINES[index],
            "label": f"iteration {iteration}",
        }
        axes[0, 0].plot(SCALES, [100 * share for share in shares], **look)
        axes[0, 1].plot(SCALES, values, **look)
        at_one = int(np.abs(SCALES - 1.0).argmin())
        print(
            f"iteration {iteration}: at scale 1 {100 * shares[at_one]:.1f} % of the box is "
            f"optimal, J of the static reward {values[at_one]:.2f}"
        )
    for panel, label in enumerate(
        ("Share of the box with J = 0 (%)", "J at all weights 1 (no unit)")
    ):
        axes[0, panel].set_xscale("log")
        axes[0, panel].set_xlabel("Scale of all penalties (1: as configured)")
        axes[0, panel].set_ylabel(label)
        axes[0, panel].axvline(1.0, color=style.GREY, linewidth=0.8)
    style.legend_above(figure, axes[0, 0].get_lines()[: len(batches)])
    return figure


@style.styled
def returned_figure(batch: Batch, names: list[str]) -> Figure:
    """Which weights the search returns, from many seeds on one and the same batch."""
    figure, axes = style.new_figure(style.TWO_COLUMNS_IN, 2.6, columns=2, sharey=True)
    objective = RankDeviation(0.1)
    for panel, tie_break in enumerate(("first", "largest_norm")):
        found = [
            configured("gwo", len(names), objective, seed, tie_break=tie_break).update(*batch)
            for seed in range(SEARCHES)
        ]
        weights = torch.stack([update.weights for update in found]).numpy()
        optimal = np.mean([update.objective == 0.0 for update in found])
        middle = ", ".join(
            f"{n} {m:.2f}" for n, m in zip(names, np.median(weights, 0), strict=True)
        )
        print(f"{tie_break}: J = 0 in {optimal:.0%} of {SEARCHES} searches; medians {middle}")
        axes[0, panel].boxplot(
            weights,
            orientation="horizontal",
            tick_labels=names,
            showfliers=False,
            medianprops={"color": style.VERMILLION},
        )
        style.panel_letter(axes[0, panel], "ab"[panel], f"tie_break: {tie_break}")
        axes[0, panel].set_xlabel("Weight returned (no unit)")
        axes[0, panel].set_xlim(-0.03, 1.03)
    return figure


if __name__ == "__main__":
    main()
