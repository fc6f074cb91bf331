"""The page on citing: BibTeX from CITATION.cff."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml


def page_of(file: Path) -> str:
    """Return the page."""
    about = yaml.safe_load(file.read_text(encoding="utf-8"))
    entries = [_software(about), *(_paper(one) for one in about["references"])]
    blocks = [f"```bibtex\n{entry}\n```\n" for entry in entries]
    tools = "Tools read [CITATION.cff](https://citation-file-format.github.io) in the root of the repository.\n"
    return "\n".join(["# Cite\n", f"{about['message']}\n", *blocks, tools])


def _software(about: Mapping[str, Any]) -> str:
    fields = {
        "title": about["title"],
        "author": _names(about["authors"]),
        "version": about["version"],
        "note": f"{about['license']} license",
    }
    return _entry("software", "sprl_bench", fields)


def _paper(reference: Mapping[str, Any]) -> str:
    fields = {
        "title": reference["title"],
        "author": _names(reference["authors"]),
        "booktitle": reference["conference"]["name"],
        "year": reference["year"],
        "note": ", ".join(one["value"] for one in reference["identifiers"]),
    }
    family = reference["authors"][0]["family-names"].lower()
    return _entry("inproceedings", f"{family}{reference['year']}{reference['title'].split('-')[0].lower()}", fields)


def _names(authors: list[Mapping[str, str]]) -> str:
    """Return authors as BibTeX has them; a name that is no person's is kept in one piece."""
    return " and ".join(
        f"{one['family-names']}, {one['given-names']}" if "family-names" in one else f"{{{one['name']}}}"
        for one in authors
    )


def _entry(kind: str, key: str, fields: Mapping[str, object]) -> str:
    width = max(map(len, fields))
    lines = [f"  {name.ljust(width)} = {{{value}}}" for name, value in fields.items()]
    return f"@{kind}{{{key},\n" + ",\n".join(lines) + "\n}"
