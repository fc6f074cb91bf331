"""From a source to the page: one HTML file with its data, its scripts and its style inside.

Names are escaped wherever they stand. The page's own policy lets a browser run no script but those written here, and
lets it load nothing.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

from sprl_bench.durations import duration
from sprl_bench.records import write_bytes
from sprl_bench.report.content import Content, content_of
from sprl_bench.report.source import Source
from sprl_bench.tables.comparable import short_commits

ASSETS: Final = Path(__file__).parent / "assets"
SCRIPTS: Final = ("vega.min.js", "vega-lite.min.js", "vega-embed.min.js", "report.js")
UNSAFE: Final = str.maketrans({"<": "\\u003c", ">": "\\u003e", "&": "\\u0026"})  # so that no text ends the element


def write_report(source: Source, output: Path) -> None:
    """Write the page, whole or not at all; the same source gives the same bytes."""
    write_bytes(output, render_report(source).encode())


def render_report(source: Source, *, refresh_s: float = 0) -> str:
    """Return the page.

    Args:
        source: What it shows.
        refresh_s: Seconds after which it asks its server for news; 0 for a page that asks for nothing.
    """
    scripts = [_read(name) for name in SCRIPTS]
    content = content_of(source)
    return _template().render(
        content=content,
        data=embedded(_data(content)),
        policy=_policy(scripts, "'self'" if refresh_s else "'none'"),
        refresh_s=refresh_s,
        scripts=[Markup(script) for script in scripts],
        style=Markup(_read("report.css")),
        version=version("sprl-bench"),
    )


def _template() -> Template:
    environment = Environment(
        autoescape=True,
        loader=FileSystemLoader(ASSETS),
        lstrip_blocks=True,
        trim_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters |= {"duration": _duration, "names": _names, "short": short_commits}
    return environment.get_template("report.html.jinja")


def _duration(seconds: float | None) -> str:
    return "-" if seconds is None else duration(seconds)


def _names(settings: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the hyperparameters of all tasks, each once."""
    return list(dict.fromkeys(name for values in settings.values() for name in values))


def _data(content: Content) -> dict[str, Any]:
    return {"agents": [agent._asdict() for agent in content.agents], **content.data}


def embedded(data: object) -> Markup:
    """Return JSON that can stand inside a script element, whatever text it holds."""
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return Markup(text.translate(UNSAFE))


def _read(name: str) -> str:
    return (ASSETS / name).read_text(encoding="utf-8")


def _policy(scripts: list[str], connect: str) -> str:
    """Return the content security policy: these scripts, by their hashes, and nothing from anywhere else."""
    hashes = " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(one.encode()).digest()).decode()}'" for one in scripts)
    return (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:; "
        f"connect-src {connect}; base-uri 'none'; form-action 'none'"
    )
