"""filterpy's Kalman equations without the rest of filterpy.

``import filterpy.kalman`` runs the package's ``__init__``, which loads scipy.stats: 0.8 s and 60 MiB on a desktop, more
on the small computers this flies on. Of all that, ``predict`` and ``update`` of ``kalman_filter.py`` are needed, so
that one file is loaded by itself, from the installed library, with its two helpers in place.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any


def _load() -> ModuleType:
    spec = importlib.util.find_spec("filterpy")  # finds, does not run
    if spec is None or not spec.submodule_search_locations:
        raise ImportError("filterpy is not installed: pip install filterpy==2.0.0")
    root = Path(spec.submodule_search_locations[0])
    helpers = _run("_filterpy_helpers", root / "common" / "helpers.py")
    # kalman_filter.py imports a log-density (for a likelihood not used here) and two formatting helpers.
    stats, common = ModuleType("filterpy.stats"), ModuleType("filterpy.common")
    stats.logpdf = None  # type: ignore[attr-defined]
    common.pretty_str = helpers.pretty_str  # type: ignore[attr-defined]
    common.reshape_z = helpers.reshape_z  # type: ignore[attr-defined]
    stand_ins = {"filterpy": ModuleType("filterpy"), "filterpy.stats": stats, "filterpy.common": common}
    before = {name: sys.modules.get(name) for name in stand_ins}
    sys.modules.update(stand_ins)
    try:
        return _run("_filterpy_kalman_filter", root / "kalman" / "kalman_filter.py")
    finally:
        # Whoever imports filterpy later gets the real one.
        for name, module in before.items():
            if module is None:
                del sys.modules[name]
            else:
                sys.modules[name] = module


def _run(name: str, path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"filterpy: {path.name} is missing; this needs filterpy==2.0.0")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


_kalman_filter = _load()
predict: Callable[..., Any] = _kalman_filter.predict
update: Callable[..., Any] = _kalman_filter.update
