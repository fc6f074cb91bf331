"""The size of a figure: as wide as its panels need, or as a column or a page of a paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from sprl_bench.plots.style import LEGEND_ROW, PANEL, SAMPLE, inches
from sprl_bench.suggestions import unknown

WIDTHS: Final[Mapping[str, float]] = MappingProxyType({"one-column": 3.3, "two-column": 6.9})
"""Inches, of a column and of a page; the usual templates of conferences have little more."""
NARROWEST = 1.6  # inches, of a panel in a paper
LARGEST_LEGEND = 0.25  # of the panels' height, from which on a legend has short names


@dataclass(frozen=True)
class Sheet:
    """Where panels and legend go.

    Attributes:
        size: Width and height of the figure in inches.
        columns: Panels beside one another.
        rows: Panels below one another.
        names: What the legend says, one an agent.
        abreast: Names beside one another.
        letters: That fit into a line above a panel.
    """

    size: tuple[float, float]
    columns: int
    rows: int
    names: Sequence[str]
    abreast: int
    letters: int


def lay_out(
    panels: tuple[int, int], names: Sequence[str], short_names: Sequence[str], width: str | None = None
) -> Sheet:
    """Return the sheet of a figure.

    Args:
        panels: How many there are, and how many may stand beside one another.
        names: Of the agents, with all that a legend can say.
        short_names: Those to take where `names` take too much of the figure.
        width: One of `WIDTHS`; None for one that panels and names need.

    Raises:
        ValueError: There is no such width.
    """
    check_width(width)
    number, most = panels
    columns = min(number, most if width is None else max(1, min(most, int(WIDTHS[width] / NARROWEST))))
    panel = PANEL if width is None else (WIDTHS[width] / columns, 0.35 + 0.68 * WIDTHS[width] / columns)
    rows = -(-number // columns)
    for chosen in (names, short_names):
        longest = max(map(inches, chosen)) + SAMPLE
        wide = max(columns * panel[0], longest) if width is None else WIDTHS[width]
        abreast = max(1, int(wide / longest))
        legend = LEGEND_ROW * -(-len(chosen) // abreast) + 0.2
        if legend <= LARGEST_LEGEND * rows * panel[1]:
            break
    return Sheet((wide, rows * panel[1] + legend), columns, rows, chosen, abreast, int(13 * wide / columns))


def check_width(width: str | None) -> None:
    """Refuse a width that is no preset.

    Raises:
        ValueError: The message lists the presets.
    """
    if width is not None and width not in WIDTHS:
        raise ValueError(unknown("width", width, WIDTHS))
