"""``replay`` with other numbers in its search: ``python settings.py TRUST=0.25 FLOOR=0.4 -- diagnose LOG...``.

A name is a constant of a module of ``replay.search``; every module that holds it gets the value. One that none holds is
refused, so that a renamed constant cannot pass for a setting that changes nothing.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from pkgutil import iter_modules

import replay.search
from replay.cli import main


def use(settings: Mapping[str, float]) -> None:
    """Put the numbers in place; ValueError names one that no module has."""
    modules = [import_module(f"replay.search.{m.name}") for m in iter_modules(replay.search.__path__)]
    for name, value in settings.items():
        holders = [m for m in modules if isinstance(getattr(m, name, None), float)]
        if not holders:
            raise ValueError(f"no module of replay.search has a number called {name}")
        for module in holders:
            setattr(module, name, value)


def parse(words: Sequence[str]) -> dict[str, float]:
    """``["TRUST=0.25"]`` as numbers by name."""
    return {name: float(value) for name, value in (w.split("=") for w in words)}


if __name__ == "__main__":
    split = sys.argv.index("--")
    use(parse(sys.argv[1:split]))
    raise SystemExit(main(sys.argv[split + 1 :]))
