"""Sizes kept with a model: what flights measured is the prior of the next one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from companion.adaptation.adapt import Adaptation
from models.errors import ConfigError
from models.surrogate.fan_surrogate import FanSurrogate
from models.surrogate.store import save_model

_OF_THE_DAY = ("wind_north", "wind_east")
"""Not of the vehicle or of its air: not kept."""


def with_sizes(model: FanSurrogate, known: Adaptation, flights: Sequence[str]) -> FanSurrogate:
    """The model with the measured sizes in its ``info``, and the flights they came from behind those it had."""
    before: dict[str, Any] = dict(model.info)
    sizes = {name: numbers for name, numbers in known.as_json().items() if name not in _OF_THE_DAY}
    before["sizes"] = sizes
    before["sizes_from"] = [*before.get("sizes_from", []), *flights]
    return FanSurrogate(
        model.free_air_law, model.coordinates, model.regressor, model.calibration, model.domain,
        effects=model.effects, info=before,
    )  # fmt: skip


def save_sizes(directory: Path, model: FanSurrogate, known: Adaptation | None, flights: Sequence[str]) -> None:
    """Write the model with its sizes. ConfigError where nothing was measured."""
    if known is None or not known.learned_s:
        raise ConfigError(f"--save-model {directory}: nothing was measured in this flight, so nothing is saved")
    save_model(directory, with_sizes(model, known, flights))
