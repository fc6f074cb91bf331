"""The layers in CONTRIBUTING's table, held against the code's own imports."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
HEAVY = {"torch", "mujoco", "numba", "minigrid", "pydantic", "pandas", "pyarrow", "matplotlib"}
SOURCES = {"sprl_bench": ROOT, "sprl_baselines": ROOT / "baselines"}


def _modules() -> dict[str, Path]:
    found = {}
    for package, base in SOURCES.items():
        for path in sorted((base / package).rglob("*.py")):
            parts = path.relative_to(base).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = _modules()


def _rooms() -> dict[str, set[str]]:
    """Return the rooms of CONTRIBUTING's table, each with the rooms that it may import."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    rows = re.findall(r"^\| `(sprl_[\w.]+)` \|[^|]*\| ?([^|]*?) ?\|$", text, re.MULTILINE)
    names = {room for room, _ in rows}
    return {room: _allowed(room, cell, names) for room, cell in rows}


def _allowed(room: str, cell: str, names: set[str]) -> set[str]:
    if cell == "everything":
        return {"sprl_bench"}
    package = room.partition(".")[0]
    found = set()
    for name in re.findall(r"`(\w+)`", cell):
        own = f"{package}.{name}"
        found.add(own if own in names or own in MODULES else f"sprl_bench.{name}")
    return found


ROOMS = _rooms()


def _imports(path: Path) -> set[str]:
    """Return every module of ours that the file imports, anywhere in it."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    ours = {name for name in names if name.split(".")[0] in SOURCES}
    return {max((module for module in MODULES if _within(name, module)), key=len) for name in ours}


def _within(module: str, room: str) -> bool:
    return module == room or module.startswith(f"{room}.")


def _room(module: str) -> str | None:
    """Return the innermost room around a module; the face of `sprl_bench` and its `__main__` are in none."""
    return max((room for room in ROOMS if _within(module, room)), key=len, default=None)


def test_the_table_is_read() -> None:
    assert ROOMS["sprl_bench.quantiles"] == set()
    assert ROOMS["sprl_bench.scores"] == {"sprl_bench.quantiles"}
    assert ROOMS["sprl_bench.tasks"] == {"sprl_bench.scores", "sprl_bench.suggestions"}
    assert ROOMS["sprl_baselines.reachability"] >= {"sprl_baselines.bonus", "sprl_bench.solver"}


@pytest.mark.parametrize("module", sorted(module for module in MODULES if _room(module)))
def test_a_room_imports_only_what_the_table_allows(module: str) -> None:
    room = _room(module)
    assert room is not None
    for imported in _imports(MODULES[module]):
        home = _room(imported)
        allowed = home == room or any(_within(imported, below) for below in ROOMS[room])
        assert allowed, f"{module} imports {imported}"


@pytest.mark.parametrize("room", sorted(ROOMS))
def test_the_table_allows_nothing_that_no_one_needs(room: str) -> None:
    imported = {name for module in MODULES if _room(module) == room for name in _imports(MODULES[module])}
    idle = {below for below in ROOMS[room] if not any(_within(name, below) for name in imported)}
    assert not idle, f"{room} is allowed {sorted(idle)}, and does not import it"


def test_every_module_has_a_room() -> None:
    homeless = {module for module in MODULES if _room(module) is None}
    assert homeless == {"sprl_bench", "sprl_bench.__main__"}


@pytest.mark.parametrize("package", sorted(SOURCES))
def test_a_file_name_is_there_once(package: str) -> None:
    """But for the faces, and for the commands, whose files are named after them."""
    paths = [path for path in (SOURCES[package] / package).rglob("*.py") if path.parent.name != "cli"]
    names = Counter(path.name for path in paths)
    assert {name for name, count in names.items() if count > 1} == {"__init__.py"}


@pytest.mark.parametrize("module", sorted(MODULES))
def test_faces_list_what_they_show_and_inner_modules_do_not(module: str) -> None:
    tree = ast.parse(MODULES[module].read_text())
    listed = any(isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__" for node in tree.body)
    is_face = MODULES[module].name == "__init__.py" and any(_shows(node, module) for node in tree.body)
    assert listed == is_face


def _shows(node: ast.stmt, face: str) -> bool:
    """Whether a statement of a face brings a name of its own package into it."""
    is_own = isinstance(node, ast.ImportFrom) and _within(node.module or "", face)
    return is_own or isinstance(node, ast.FunctionDef | ast.ClassDef)


def test_there_are_no_circles() -> None:
    graph = {module: _imports(path) - {module} for module, path in MODULES.items()}
    done: set[str] = set()

    def visit(module: str, trail: tuple[str, ...]) -> None:
        assert module not in trail, " -> ".join((*trail[trail.index(module) :], module))
        if module not in done:
            for imported in graph[module]:
                visit(imported, (*trail, module))
            done.add(module)

    for module in graph:
        visit(module, ())


def test_importing_the_package_is_light() -> None:
    code = "import sprl_bench, sys; print(*sorted({name.split('.')[0] for name in sys.modules}))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "gymnasium" in loaded
    assert not HEAVY & set(loaded)
