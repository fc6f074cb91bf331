"""The charts of a report as Vega-Lite specifications; the page gives them their data.

Text and axes have the colour of the page, so that one picture serves for light, dark and paper.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

from sprl_bench.plots.style import Look

Spec = dict[str, Any]
SCHEMA: Final = "https://vega.github.io/schema/vega-lite/v6.json"
INK: Final = "currentColor"
BLACK: Final = "#000000"
PATTERNS: Final[Mapping[str, tuple[float, ...]]] = MappingProxyType(
    {"-": (1, 0), "--": (6, 3), ":": (1.5, 2), "-.": (6, 2, 1.5, 2)}
)
"""Lengths of strokes and gaps, by matplotlib's name of the dashes."""
STEPS: Final = "Environment steps"
ROUND: Final = "datum.value === 0 ? '0' : format(datum.value, '~s')"  # 500k for 500,000
LIT: Final = "highlight === '' || highlight === datum.agent"
DIM: Final = 0.12  # of the usual opacity, for other agents than the one that is lit up


def colour_of(look: Look) -> str:
    """Return an agent's colour in the page: black would be lost on a dark one."""
    return INK if look.colour == BLACK else look.colour


def specs_of(looks: Mapping[str, Look]) -> dict[str, Spec]:
    """Return the specification of each kind of chart, with the colours of these agents."""
    names = list(looks)
    colour = {"domain": names, "range": [colour_of(look) for look in looks.values()]}
    dash = {"domain": names, "range": [list(PATTERNS[look.dashes]) for look in looks.values()]}
    encode = {
        "color": {"field": "agent", "type": "nominal", "scale": colour, "legend": None},
        "strokeDash": {"field": "agent", "type": "nominal", "scale": dash, "legend": None},
    }
    steps, share = _axis(STEPS, labelExpr=ROUND), _axis("AUC, share of the score range")
    whole, above = {"title": STEPS, "format": ",.0f"}, {"title": "AUC above", "format": ".4~g"}
    return {
        "curve": _lines(encode, _x(steps), _axis("Mean return"), whole),
        "metric": _lines(encode, _x(steps), _axis(""), whole),
        "profile": _lines(encode, _x(share), _axis("Share of runs above"), above),
        "interval": _intervals(encode, _axis("")),
        "improvement": _improvements(encode),
    }


def _axis(title: str, **others: Any) -> Spec:
    return {"title": title, "tickCount": 5, **others}


def _x(axis: Spec) -> Spec:
    return {"field": "x", "type": "quantitative", "axis": axis, "scale": {"nice": False}}


def _base(*names: str) -> Spec:
    """Return what all charts share; `names` are those of their data."""
    return {
        "$schema": SCHEMA,
        "width": "container",
        "background": None,
        "datasets": {name: [] for name in names},
        "params": [{"name": "highlight", "value": ""}],
        "config": {
            "font": "system-ui, sans-serif",
            "view": {"stroke": None},
            "axis": {
                "labelColor": INK,
                "titleColor": INK,
                "domainColor": INK,
                "tickColor": INK,
                "gridColor": INK,
                "gridOpacity": 0.12,
                "domainOpacity": 0.4,
                "tickOpacity": 0.4,
                "labelFontSize": 12,
                "titleFontSize": 12,
                "titleFontWeight": "normal",
                "labelLimit": 220,
                "labelSeparation": 6,
            },
        },
    }


def _y(field: str, axis: Spec) -> Spec:
    return {"field": field, "type": "quantitative", "axis": axis, "scale": {"zero": False}}


def _bright(opacity: float) -> Spec:
    """Return this opacity, and little of it while another agent is lit up."""
    return {"condition": {"test": LIT, "value": opacity}, "value": DIM * opacity}


def _lines(encode: Spec, x: Spec, axis: Spec, x_read: Spec) -> Spec:
    """Return the mean of each agent as a line with its band, and its runs as thin lines; a pointer lights one up."""
    band = {
        "mark": {"type": "area", "aria": False},
        "data": {"name": "bands"},
        "encoding": {
            "x": x,
            "y": _y("low", axis),
            "y2": {"field": "high"},
            "opacity": _bright(0.15),
            "color": encode["color"],
        },
    }
    runs = {
        "mark": {"type": "line", "strokeWidth": 0.7, "aria": False},
        "data": {"name": "runs"},
        "encoding": {
            "x": x,
            "y": _y("y", axis),
            "opacity": _bright(0.4),
            "detail": {"field": "run", "type": "nominal"},
            **encode,
        },
    }
    means = {
        "mark": {"type": "line", "strokeWidth": 2, "aria": False},
        "data": {"name": "means"},
        "encoding": {"x": x, "y": _y("y", axis), "opacity": _bright(1), **encode},
    }
    return {
        **_base("bands", "runs", "means", "points"),
        "height": 220,
        "layer": [band, runs, means, _pointer(x, axis, x_read)],
    }


def _pointer(x: Spec, axis: Spec, x_read: Spec) -> Spec:
    """Return points that cannot be seen, which the pointer finds; a finger stays on one until it taps elsewhere.

    They are those of the means, in the one chart that is pointed at.
    """
    hover = {"type": "point", "fields": ["agent"], "on": "mouseover", "clear": "mouseout", "nearest": True}
    tooltip = [
        {"field": "label", "type": "nominal", "title": "Agent"},
        {"field": "x", "type": "quantitative", **x_read},
        {"field": "y", "type": "quantitative", "title": "Mean", "format": ".4~g"},
        {"field": "interval", "type": "nominal", "title": "95 % interval"},
    ]
    return {
        "mark": {"type": "point", "opacity": 0, "size": 30, "aria": False},
        "data": {"name": "points"},
        "params": [{"name": "hover", "select": hover}],
        "encoding": {"x": x, "y": _y("y", axis), "tooltip": tooltip},
    }


def _intervals(encode: Spec, axis: Spec) -> Spec:
    """Return a point with its interval for each agent, one below the other, and small points for single runs."""
    rows: Spec = {"field": "label", "type": "nominal", "sort": None, "axis": {"title": None}}
    shared = {"y": rows, "color": encode["color"]}
    seeds = {
        "mark": {"type": "point", "size": 18, "opacity": 0.5, "aria": False},
        "data": {"name": "runs"},
        "encoding": {**shared, "x": _y("x", axis)},
    }
    return {**_base("means", "runs"), "height": {"step": 24}, "layer": [*_whiskers(shared, axis), seeds]}


def _whiskers(shared: Spec, axis: Spec, x: Spec | None = None) -> Sequence[Spec]:
    tooltip = [
        {"field": "label", "type": "nominal", "title": "Agent"},
        {"field": "x", "type": "quantitative", "title": "Value", "format": ".4~g"},
        {"field": "interval", "type": "nominal", "title": "95 % interval"},
    ]
    rule = {
        "mark": {"type": "rule", "strokeWidth": 2, "aria": False},
        "data": {"name": "means"},
        "encoding": {**shared, "x": {**_y("low", axis), **(x or {})}, "x2": {"field": "high"}, "tooltip": tooltip},
    }
    point = {
        "mark": {"type": "point", "filled": True, "size": 90, "opacity": 1, "aria": False},
        "data": {"name": "means"},
        "encoding": {**shared, "x": {**_y("x", axis), **(x or {})}, "tooltip": tooltip},
    }
    return rule, point


def _improvements(encode: Spec) -> Spec:
    """Return the probability that each agent improves on the reference, with a line at one half."""
    axis = _axis("Probability of improvement")
    rows: Spec = {"field": "label", "type": "nominal", "sort": None, "axis": {"title": None}}
    half = {
        "mark": {"type": "rule", "strokeDash": [4, 3], "color": INK, "opacity": 0.6, "aria": False},
        "data": {"values": [{"half": 0.5}]},
        "encoding": {"x": {"field": "half", "type": "quantitative"}},
    }
    whiskers = _whiskers({"y": rows, "color": encode["color"]}, axis, {"scale": {"domain": [0, 1]}})
    return {**_base("means"), "height": {"step": 24}, "layer": [half, *whiskers]}
