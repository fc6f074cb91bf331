"""The layers of CONTRIBUTING.md, held against the code's own imports."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
LEAF = {"sprl_bench.suggestions"}
DATA = {"sprl_bench.tasks", "sprl_bench.records", "sprl_bench.metrics"}
BELOW_RUN = DATA | {"sprl_bench.recorder", "sprl_bench.agents", "sprl_bench.machine", "sprl_bench.checkpoint"}
ALLOWED = {
    "sprl_bench.envs": set(),
    "sprl_bench.solver": {"sprl_bench.envs"},
    "sprl_bench.theory": {"sprl_bench.envs", "sprl_bench.solver"},
    "sprl_bench.tasks": {"sprl_bench.metrics"},
    "sprl_bench.metrics": set(),
    "sprl_bench.records": DATA,
    "sprl_bench.agents": set(),
    "sprl_bench.recorder": DATA | {"sprl_bench.machine"},
    "sprl_bench.machine": DATA,
    "sprl_bench.checkpoint": DATA,
    "sprl_bench.process": DATA,
    "sprl_bench.run": BELOW_RUN | {"sprl_bench.process"},
    "sprl_bench.executors": BELOW_RUN | {"sprl_bench.run"},
    "sprl_bench.suite": BELOW_RUN | {"sprl_bench.run", "sprl_bench.executors"},
    "sprl_bench.policies": BELOW_RUN | {"sprl_bench.envs", "sprl_bench.solver"},
    "sprl_bench.video": {"sprl_bench.agents", "sprl_bench.envs", "sprl_bench.policies", "sprl_bench.tasks"},
    "sprl_bench.tables": DATA,
    "sprl_bench.plots": DATA | {"sprl_bench.tables"},
    "sprl_bench.theory_plots": {"sprl_bench.envs", "sprl_bench.theory", "sprl_bench.plots"},
    "sprl_bench.doctor": DATA | {"sprl_bench.envs", "sprl_bench.tables"},
    "sprl_bench.leaderboard": DATA | {"sprl_bench.tables"},
    "sprl_baselines": {"sprl_bench.agents", "sprl_bench.solver"},
}
HEAVY = {"torch", "mujoco", "numba", "minigrid", "pydantic", "pandas", "pyarrow", "matplotlib"}


def _modules() -> dict[str, Path]:
    found = {}
    for base, package in ((ROOT, "sprl_bench"), (ROOT / "baselines", "sprl_baselines")):
        for path in sorted((base / package).rglob("*.py")):
            parts = path.relative_to(base).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = _modules()


def _imports(path: Path) -> set[str]:
    """Return every module of ours that the file imports, wherever in it the import stands."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    ours = {name for name in names if name.split(".")[0] in ("sprl_bench", "sprl_baselines")}
    return {max((module for module in MODULES if _within(name, module)), key=len) for name in ours}


def _within(module: str, room: str) -> bool:
    return module == room or module.startswith(f"{room}.")


def _room(module: str) -> str | None:
    rooms = [room for room in ALLOWED if _within(module, room)]
    return max(rooms, key=len) if rooms else None


@pytest.mark.parametrize("module", sorted(module for module in MODULES if _room(module)))
def test_a_room_imports_only_from_the_rooms_below_it(module: str) -> None:
    room = _room(module)
    assert room is not None
    for imported in _imports(MODULES[module]):
        allowed = _within(imported, room) or any(_within(imported, below) for below in ALLOWED[room] | LEAF)
        assert allowed, f"{module} imports {imported}"


def test_every_module_of_the_core_has_a_room() -> None:
    free = {"sprl_bench", "sprl_bench.__main__", "sprl_bench.cli", "sprl_bench.suggestions", "sprl_bench.progress"}
    homeless = [
        name for name in MODULES if _room(name) is None and not any(_within(name, f) for f in free - {"sprl_bench"})
    ]
    assert set(homeless) <= free


@pytest.mark.parametrize("module", sorted(MODULES))
def test_a_module_lists_what_it_shows(module: str) -> None:
    body = ast.parse(MODULES[module].read_text()).body
    shows = [
        node.name
        for node in body
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_") and not _is_command(node)
    ]
    lists = any(isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__" for node in body)
    assert lists or not shows


def _is_command(node: ast.ClassDef | ast.FunctionDef) -> bool:
    """Whether it is a command of the command line, which nobody imports."""
    return any("command(" in ast.unparse(decorator) for decorator in node.decorator_list)


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
    import subprocess
    import sys

    code = "import sprl_bench, sys; print(*sorted({name.split('.')[0] for name in sys.modules}))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "gymnasium" in loaded
    assert not HEAVY & set(loaded)
