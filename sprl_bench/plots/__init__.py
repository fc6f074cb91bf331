"""Pictures of results: learning curves, metrics, scores along an axis, and whole suites. Drawn without a display."""

from __future__ import annotations

from sprl_bench.plots.axis import Point, draw_axis, plot_axis, points_of
from sprl_bench.plots.curves import draw_curves, plot, plot_results
from sprl_bench.plots.metrics import draw_metrics, plot_metrics
from sprl_bench.plots.sheet import WIDTHS
from sprl_bench.plots.style import PAPER, STYLE, SUFFIXES, UNDATED, save
from sprl_bench.plots.suite_wide import (
    KINDS,
    board_matrices,
    draw_improvement,
    draw_profiles,
    plot_suites,
    suite_labels,
    suite_matrices,
)

__all__ = [
    "KINDS",
    "PAPER",
    "STYLE",
    "SUFFIXES",
    "UNDATED",
    "WIDTHS",
    "Point",
    "board_matrices",
    "draw_axis",
    "draw_curves",
    "draw_improvement",
    "draw_metrics",
    "draw_profiles",
    "plot",
    "plot_axis",
    "plot_metrics",
    "plot_results",
    "plot_suites",
    "points_of",
    "save",
    "suite_labels",
    "suite_matrices",
]
