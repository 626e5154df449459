"""Which module may import which: never a higher package, and never in a circle, of modules or of folders."""

from __future__ import annotations

import ast
from functools import cache
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("models", "companion", "replay")
"""From the lowest to the highest."""
COMMANDS = ("cli", "__main__")
"""Modules above all folders of their package: they put commands together."""


def modules() -> dict[str, Path]:
    out = {}
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            parts = path.relative_to(ROOT).with_suffix("").parts
            out[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return out


@cache
def imports() -> dict[str, set[str]]:
    """Module -> modules that it imports, also inside functions and for types only."""
    known, out = modules(), {}
    for name, path in known.items():
        found = set()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        out[name] = {other for other in found if other in known and other != name}
    return out


def reached(start: str, graph: dict[str, set[str]]) -> set[str]:
    """All modules that ``start`` imports, directly or not."""
    seen: set[str] = set()
    waiting = [start]
    while waiting:
        for other in graph[waiting.pop()] - seen:
            seen.add(other)
            waiting.append(other)
    return seen


def test_no_package_imports_a_higher_one() -> None:
    rank = {package: place for place, package in enumerate(PACKAGES)}
    up = [
        (name, other)
        for name, others in imports().items()
        for other in others
        if rank[other.split(".")[0]] > rank[name.split(".")[0]]
    ]
    assert up == []


def circles(graph: dict[str, set[str]]) -> list[set[str]]:
    """The sets of names that reach each other."""
    below = {name: reached(name, graph) for name in graph}
    found = {
        frozenset(o for o in below[name] if name in below[o])
        for name in graph
        if name in below[name]
    }
    return [set(circle) for circle in found]


def folder(module: str) -> str:
    """The folder of a module in its package; a module that lies in no folder stands for itself."""
    parts = module.split(".")
    if len(parts) > 1 and parts[-1] in COMMANDS:
        return f"{parts[0]}.{COMMANDS[0]}"
    return ".".join(parts[:2])


def test_no_modules_import_each_other_in_a_circle() -> None:
    assert circles(imports()) == []


def test_no_folders_import_each_other_in_a_circle() -> None:
    graph: dict[str, set[str]] = {}
    for name, others in imports().items():
        graph.setdefault(folder(name), set()).update(
            folder(other) for other in others if folder(other) != folder(name)
        )
    assert [sorted(circle) for circle in circles(graph)] == []


def test_what_commands_that_measure_import_is_there() -> None:
    """No test runs all of them: they would break unseen where a name changes."""
    known, missing = modules(), []
    for path in (ROOT / "tests").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.ImportFrom) or node.module not in known:
                continue
            home = import_module(node.module)
            missing += [
                f"{path.relative_to(ROOT)}: {node.module}.{alias.name}"
                for alias in node.names
                if f"{node.module}.{alias.name}" not in known and not hasattr(home, alias.name)
            ]
    assert missing == []
