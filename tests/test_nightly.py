"""What CI shortens, a nightly workflow runs at the length that the pages name."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).parents[1]
NIGHTLY: Final = (ROOT / ".github" / "workflows" / "nightly.yml").read_text()
NAMED: Final = re.findall(r"`(SPRL_\w+)=(\d+)`", (ROOT / "docs" / "trust.md").read_text())


def test_the_page_names_kills_and_orders() -> None:
    assert {name for name, _ in NAMED} == {"SPRL_KILLS", "SPRL_ORDERS"}


@pytest.mark.parametrize(("name", "length"), NAMED)
def test_the_nightly_workflow_repeats_a_figure(name: str, length: str) -> None:
    assert re.search(rf'^ +{name}: "{length}"$', NIGHTLY, re.MULTILINE)
