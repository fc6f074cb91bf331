"""Pictures of results: learning curves, what agents log, and scores along an axis. Drawn without a display."""

from __future__ import annotations

from sprl_bench.plots.axis import Point, draw_axis, plot_axis, points_of
from sprl_bench.plots.curves import draw_curves, plot, plot_results
from sprl_bench.plots.metrics import draw_metrics, plot_metrics
from sprl_bench.plots.style import STYLE, SUFFIXES, UNDATED, save

__all__ = [
    "STYLE",
    "SUFFIXES",
    "UNDATED",
    "Point",
    "draw_axis",
    "draw_curves",
    "draw_metrics",
    "plot",
    "plot_axis",
    "plot_metrics",
    "plot_results",
    "points_of",
    "save",
]
