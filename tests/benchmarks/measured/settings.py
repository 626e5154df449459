"""``replay`` with a search that is changed: ``TRUST=0.25 predictive=off -- diagnose LOG...``.

A name is a constant or a function of a module of ``replay.search``; every module that holds it gets the value. A
function that is ``off`` gives its first argument back. A name that no module holds is refused, so that a renamed one
cannot pass for a setting that changes nothing.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from importlib import import_module
from pkgutil import iter_modules
from typing import Any
from unittest.mock import patch

import replay.cli
import replay.search

OFF = "off"
Value = float | str
"""A number, or ``OFF``."""


@contextmanager
def used(settings: Mapping[str, Value]) -> Iterator[None]:
    """The search with these settings; ValueError names one that no module has."""
    modules = [
        import_module(f"replay.search.{m.name}") for m in iter_modules(replay.search.__path__)
    ]
    with ExitStack() as stack:
        for name, value in settings.items():
            holders = [m for m in modules if _fits(getattr(m, name, None), value)]
            if not holders:
                raise ValueError(f"no module of replay.search has a {_kind(value)} called {name}")
            for module in holders:
                stack.enter_context(patch.object(module, name, _first if value == OFF else value))
        yield


def parse(words: Sequence[str]) -> dict[str, Value]:
    """``["TRUST=0.25", "predictive=off"]`` by name."""
    return {
        name: OFF if value == OFF else float(value) for name, value in (w.split("=") for w in words)
    }


def _fits(held: float | Callable[..., Any] | None, value: Value) -> bool:
    return callable(held) if value == OFF else isinstance(held, float)


def _kind(value: Value) -> str:
    return "function" if value == OFF else "number"


def _first(given: Any, *_: Any) -> Any:
    return given


def main() -> int:
    words = sys.argv[1:]
    end = words.index("--") if "--" in words else len(words)
    p = argparse.ArgumentParser(
        description=__doc__,
        usage="%(prog)s NAME=VALUE... -- COMMAND...",
    )
    p.add_argument("settings", nargs="*", metavar="NAME=VALUE")
    a = p.parse_args(words[:end])
    with used(parse(a.settings)):
        return replay.cli.main(words[end + 1 :])


if __name__ == "__main__":
    sys.exit(main())
