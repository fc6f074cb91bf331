"""A page to look at: one file that needs no network, or the same page served while runs go on."""

from __future__ import annotations

from sprl_bench.report.document import render_report, write_report
from sprl_bench.report.server import make_server
from sprl_bench.report.source import Origin, Progress, Source, of_board, of_runs

__all__ = ["Origin", "Progress", "Source", "make_server", "of_board", "of_runs", "render_report", "write_report"]
