"""Hooks of the site (mkdocs.yml): the README is its first page, what is public its reference; links out are names."""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from types import ModuleType
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

import companion
import models
import replay
from models.common import errors
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle, load_vehicle
from replay.logs.plugins import LogReader

ROOT = Path(__file__).resolve().parents[1]
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s#]+)(#[^)\s]*)?\)")
_SCHEME = re.compile(r"[a-z]+:")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """The pages that no file of the folder holds."""
    home = re.sub(r"\]\(docs/", "](", (ROOT / "README.md").read_text("utf-8"))
    for name, text in (("index.md", home), ("reference.md", reference())):
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """A link to a file outside the manual is its name alone: the site is read without the repository."""
    above = posixpath.dirname(page.file.src_uri)

    def kept(found: re.Match[str]) -> str:
        _, name, target, _ = found.groups()
        place = posixpath.normpath(posixpath.join(above, target))
        inside = (ROOT / "docs" / place).is_file() or place in ("index.md", "reference.md")
        if _SCHEME.match(target) or (inside and not place.startswith("..")):
            return found[0]
        return name

    return _LINK.sub(kept, markdown)


def reference() -> str:
    """One entry for every public name, from its docstring."""
    lines = [
        "# Reference",
        "",
        "What is listed here is stable; how to begin: [library](library.md).",
        "",
    ]
    for package in (models, companion, replay):
        public = {f"{package.__name__}.{name}": getattr(package, name) for name in _public(package)}
        lines += _entries(package.__name__, public)
    lines += _entries("A surrogate", {"FanSurrogate": FanSurrogate})
    vehicle = (load_vehicle, Vehicle)
    lines += _entries("models.vehicle", {f"models.vehicle.{v.__name__}": v for v in vehicle})
    lines += _entries("A log format", {"LogReader": LogReader})
    kinds = (errors.UserError, *errors.UserError.__subclasses__())
    lines += _entries("models.common.errors", {kind.__name__: kind for kind in kinds})
    return "\n".join(lines)


def _entries(heading: str, things: dict[str, Any]) -> list[str]:
    """Under the names by which they are imported."""
    lines = [f"## {heading}", ""]
    for name, thing in sorted(things.items()):
        options = f"    options:\n      heading: {name}\n      toc_label: {name}"
        lines += [f"::: {_home(thing)}", options, ""]
    return lines


def _public(package: ModuleType) -> list[str]:
    return [name for name in package.__all__ if not name.startswith("__")]


def _home(thing: Any) -> str:
    """Where it is written down."""
    return f"{thing.__module__}.{thing.__qualname__}"
