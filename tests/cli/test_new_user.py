"""What a new user does: train, and open the report by the one command that `run` suggests."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

LAUNCHER = "import sys\nfrom sprl_bench.cli import main\nif __name__ == '__main__':\n    sys.exit(main())\n"
RUN = "run --suite smoke --agents random --seeds 1 --budget 2000 --workers 1 --out 'my runs'"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with an environment that is not active, and a browser that notes what it opens."""
    programs = {
        ".venv/bin/sprl-bench": f"#!{sys.executable}\n{LAUNCHER}",
        "browser": '#!/bin/sh\necho "$1" > opened.txt\n',
    }
    for name, text in programs.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    return tmp_path


def typed(line: str, folder: Path, browser: str) -> subprocess.CompletedProcess[str]:
    """Return what comes of a line in a shell that does not find `sprl-bench` by its name."""
    environment = {**os.environ, "PATH": "/usr/bin:/bin", "BROWSER": browser}
    return subprocess.run(
        ["bash", "-c", line], cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=300
    )


def test_run_suggests_the_command_that_opens_the_report(folder: Path) -> None:
    done = typed(f".venv/bin/sprl-bench {RUN}", folder, "")
    assert done.returncode == 0, done.stderr
    [line] = [line for line in done.stdout.splitlines() if line.startswith("Next:")]
    opened = typed(line.removeprefix("Next:"), folder, str(folder / "browser"))
    assert opened.returncode == 0, opened.stderr
    page = Path(unquote(urlsplit((folder / "opened.txt").read_text().strip()).path))
    assert page == folder / "report.html"
    assert "FourRooms-7x7" in page.read_text()


def test_where_there_is_no_browser_the_address_is_printed(folder: Path) -> None:
    assert typed(f".venv/bin/sprl-bench {RUN}", folder, "").returncode == 0
    code = "import webbrowser; webbrowser.open = lambda _: False; from sprl_bench.cli import main; main()"
    done = typed(f"{sys.executable} -c '{code}' report 'my runs' --open", folder, "")
    assert done.returncode == 0
    assert f"open file://{folder}/report.html in one." in done.stderr
