"""What flights measured, kept with a model: the prior of the next flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from companion.adaptation import judge
from companion.adaptation.adaptation import Adaptation
from companion.adaptation.near_map import CELLS
from companion.adaptation.sizes import GAINS
from models.errors import ConfigError, ModelError
from models.surrogate.fan_surrogate import FanSurrogate
from models.surrogate.store import save_model

_OF_THE_DAY = ("wind_north", "wind_east")
"""Not of the vehicle or of its air: not kept."""
_KEY = "near_field"
"""In ``model.json``: {gain: {"log_odds", "mean": [with the model, without it]}}, each mean from the gain on."""


def with_sizes(model: FanSurrogate, known: Adaptation, flights: Sequence[str]) -> FanSurrogate:
    """The model with what was measured in its ``info``, and the flights it came from behind those it had."""
    before: dict[str, Any] = dict(model.info)
    sizes = {name: numbers for name, numbers in known.as_json().items() if name not in _OF_THE_DAY}
    before["sizes"] = sizes
    before["sizes_from"] = [*before.get("sizes_from", []), *flights]
    kept = [judge.to_keep(c, j) for c, j in zip(known.channels, known.judged, strict=True)]
    before[_KEY] = {
        name: {"log_odds": round(k.log_odds, 3), "mean": k.mean.round(5).tolist()}
        for name, k in zip(GAINS, kept, strict=True)
    }
    return model.with_effects(model.effects, before)


def kept_with(model: FanSurrogate) -> list[judge.Saved | None]:
    """Of lift, pull and tilt. ModelError where a file was changed by hand."""
    found: Mapping[str, Any] = model.info.get(_KEY, {})
    return [_kept(name, found[name]) if name in found else None for name in GAINS]


def _kept(name: str, told: Any) -> judge.Saved:
    try:
        mean, log_odds = np.array(told["mean"], dtype=float), float(told["log_odds"])
    except (KeyError, TypeError, ValueError):
        mean, log_odds = np.full(1, np.nan), 0.0
    if mean.shape != (2, 2 + CELLS) or not np.isfinite(mean).all() or not np.isfinite(log_odds):
        raise ModelError(
            f"model.json: key '{_KEY}.{name}' must have a finite log_odds and mean (2 x {2 + CELLS}); "
            "train or fly it again"
        )
    return judge.Saved(mean, log_odds)


def save_sizes(directory: Path, model: FanSurrogate, known: Adaptation | None, flights: Sequence[str]) -> None:
    """Write the model with its sizes. ConfigError where nothing was measured."""
    if known is None or not known.learned_s:
        raise ConfigError(f"--save-model {directory}: nothing was measured in this flight, so nothing is saved")
    save_model(directory, with_sizes(model, known, flights))
