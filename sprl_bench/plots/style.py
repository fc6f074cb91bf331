"""What all pictures share: colours, sizes, the legend, and how a figure becomes a file.

The colours are those of Okabe and Ito and of Tol, safe for colour-blind readers; when they are used up, dashes follow.
A reference agent has the same colour in every picture. matplotlib is loaded when something is drawn.
"""

from __future__ import annotations

import io
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, Literal
from zlib import crc32

import numpy as np

from sprl_bench.extras import require_extra
from sprl_bench.records import write_bytes
from sprl_bench.suggestions import unknown

if TYPE_CHECKING:  # the extra `plots`
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from sprl_bench.scores import Array

SUFFIXES = (".pdf", ".png", ".svg")
REFERENCE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#882255", "#999933")
OTHERS = ("#332288", "#44AA99", "#AA4499", "#DDCC77", "#661100")
COLOURS = (*REFERENCE, *OTHERS)
RESERVED: Final = MappingProxyType(
    dict(zip(("eco", "gt-grid", "gt-sprl", "icm", "ppo", "random", "sprl", "rnd", "count"), REFERENCE, strict=True))
)
"""The reference agents have the same colour in every picture."""
Dashes = Literal["-", "--", ":", "-."]
DASHES: Final[tuple[Dashes, ...]] = ("-", "--", ":", "-.")
COLUMNS = 4
PANEL = (3.4, 2.7)  # inches
SAMPLE = 0.7  # inches, of the line before a name in the legend and the space around both
LEGEND_ROW = 0.19  # inches
UNDATED: Mapping[str, Mapping[str, None]] = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}, ".png": {}}
STYLE: Final[Any] = {  # matplotlib keeps the type of the keys to itself
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 10,
    "font.size": 9,
    "pdf.fonttype": 42,  # TrueType; some venues refuse Type 3
    "legend.frameon": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "sprl-bench",
    "text.parse_math": False,  # a name is a name
}


@dataclass(frozen=True)
class Look:
    """How an agent is drawn, in every panel."""

    colour: str
    dashes: Dashes


def check_suffix(output: Path) -> None:
    """Refuse a file that is no picture.

    Raises:
        ValueError: Its suffix is not allowed.
    """
    if output.suffix.lower() not in SUFFIXES:
        raise ValueError(unknown("suffix of a picture:", output.suffix, SUFFIXES))


PAPER: Final[Any] = {**STYLE, "axes.titlesize": 8, "axes.titlepad": 3, "font.size": 7, "lines.markersize": 3}
"""As `STYLE`, for a figure as wide as a column or a page."""


def save(draw: Callable[[], Figure], output: Path, *, width: str | None = None) -> None:
    """Write the figure that `draw` returns to a file; the same figure gives the same bytes.

    Args:
        draw: Returns the figure; called with `PAPER` if there is a width, else with `STYLE`.
        output: A .png, .svg or .pdf file.
        width: One of `sprl_bench.plots.WIDTHS`.

    Raises:
        ModuleNotFoundError: matplotlib, of the extra `plots`, is not installed.
    """
    suffix = output.suffix.lower()
    with require_extra("matplotlib").rc_context(PAPER if width else STYLE):
        buffer = io.BytesIO()
        draw().savefig(buffer, format=suffix[1:], dpi=200, metadata=dict(UNDATED[suffix]))
    write_bytes(output, buffer.getvalue())


def looks_of(agents: Iterable[str]) -> dict[str, Look]:
    """Return each agent's look; its presets and variants, as sprl@tuned+k=3, have its colour and other dashes.

    A reference agent always has the same colour. Another agent has one of `OTHERS` that follows from its name, or the
    next free one where another agent of the picture has that. Where all are variants of one agent, each has a colour of
    its own.
    """
    looks: dict[str, Look] = {}
    colours = _colours_of(map(_family, agents := sorted(set(agents))))
    dashes_first = len(colours) > 1
    for agent in sorted(agents, key=lambda name: (_family(name) != name, name)):
        colour = colours[_family(agent)]
        wanted = [Look(colour, dashes) for dashes in (DASHES if dashes_first else DASHES[:1])]
        others = [Look(other, dashes) for dashes in DASHES for other in COLOURS]
        looks[agent] = next((look for look in (*wanted, *others) if look not in looks.values()), wanted[0])
    return dict(sorted(looks.items()))


def _colours_of(families: Iterable[str]) -> dict[str, str]:
    """Return a colour for each family, each used as rarely as possible."""
    found: dict[str, str] = {}
    for family in sorted(set(families), key=lambda name: (name not in RESERVED, name)):
        if family in RESERVED:
            found[family] = RESERVED[family]
            continue
        start = crc32(family.encode()) % len(OTHERS)
        used = Counter(found.values())
        found[family] = min((*OTHERS[start:], *OTHERS[:start], *REFERENCE), key=lambda colour: used[colour])
    return found


def _family(agent: str) -> str:
    return agent.partition("+")[0].partition("@")[0]


def draw_runs(axes: Axes, runs: Sequence[tuple[Array, Array]], look: Look) -> None:
    """Draw each run, its steps and its values, as a thin line; nothing for a single run, which is the mean itself."""
    if len(runs) > 1:
        lines = require_extra("matplotlib.collections").LineCollection(
            [np.column_stack(run) for run in runs],
            colors=look.colour,
            linestyles=look.dashes,
            linewidths=0.5,
            alpha=0.35,
        )
        axes.add_collection(lines, autolim=True)


def inches(text: str) -> float:
    """Return the width of a text in the legend."""
    from matplotlib import rcParams  # noqa: PLC0415 - the extra `plots`, and slow to load
    from matplotlib.textpath import TextPath  # noqa: PLC0415 - likewise

    points = float(TextPath((0, 0), text, size=rcParams["font.size"]).get_extents().width)
    return 1.05 * points / 72  # letters are drawn on whole pixels, a little wider than their outlines


def draw_grid(axes: Axes) -> None:
    """Draw thin lines behind the data."""
    axes.grid(visible=True, color="#e6e6e6", linewidth=0.6)
    axes.set_axisbelow(True)


def draw_caption(figure: Figure, text: str) -> None:
    """Say below all panels what lines and bands are."""
    letters = int(17 * figure.get_figwidth())
    figure.supxlabel(textwrap.fill(text, letters), fontsize=_caption_size(), color="#555555")


def _caption_size() -> float:
    """Return points, a little less than those of other text."""
    from matplotlib import rcParams  # noqa: PLC0415 - the extra `plots`, and slow to load

    return min(7.0, float(rcParams["font.size"]) - 1)


def draw_legend(figure: Figure, looks: Sequence[Look], names: Sequence[str], columns: int) -> None:
    """Name each agent once, above all panels."""
    from matplotlib.lines import Line2D  # noqa: PLC0415 - the extra `plots`, and slow to load

    lines = [Line2D([], [], color=look.colour, linestyle=look.dashes, linewidth=1.6) for look in looks]
    figure.legend(lines, names, loc="outside upper center", ncols=min(columns, len(names)))


def short_number(value: float, _position: float) -> str:
    """Return 500k for 500,000 and 2M for 2,000,000."""
    for size, letter in ((1e6, "M"), (1e3, "k")):
        if abs(value) >= size:
            return f"{value / size:g}{letter}"
    return f"{value:g}"
