"""The list of all figures, in the order of a report."""

from analysis.figures.curve_comparison import figure_autocorrelation, figure_curve_comparison
from analysis.figures.drawing import FigureSpec
from analysis.figures.false_positives import figure_false_positives
from analysis.figures.forest import figure_forest
from analysis.figures.improvement import figure_8
from analysis.figures.seeds import figure_profile, figure_seeds
from analysis.figures.tracking import figure_6, figure_7, figure_13
from analysis.figures.tradeoff import figure_tradeoff
from analysis.figures.trend import figure_trend
from analysis.figures.wall_clock import figure_15, figure_wall_clock
from analysis.figures.weights import figure_14, figure_optimum

ALL_FIGURES: tuple[FigureSpec, ...] = (
    FigureSpec("figure_06_episode_length", "Figure 6", figure_6),
    FigureSpec("figure_07_tracking_errors", "Figure 7", figure_7),
    FigureSpec("figure_08_improvement", "Figure 8", figure_8),
    FigureSpec("figure_13_seed_bands", "Figure 13", figure_13),
    FigureSpec("figure_14_weights", "Figure 14", figure_14),
    FigureSpec("figure_15_overhead", "Figure 15", figure_15),
    FigureSpec("tradeoff", "", figure_tradeoff),
    FigureSpec("seed_lines", "", figure_seeds),
    FigureSpec("performance_profile", "", figure_profile),
    FigureSpec("forest", "", figure_forest),
    FigureSpec("trend", "", figure_trend),
    FigureSpec("curve_comparison", "", figure_curve_comparison),
    FigureSpec("autocorrelation", "", figure_autocorrelation),
    FigureSpec("false_positives", "", figure_false_positives),
    FigureSpec("weights_at_optimum", "", figure_optimum),
    FigureSpec("wall_clock_split", "", figure_wall_clock),
)
