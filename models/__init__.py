"""What the air does: data, training, surrogates, effects. Numerics only; no MAVLink.

``models.load(DIR)`` gives the surrogate of a fan, ``models.load()`` the shipped one; neither needs torch. Names are
looked up when first used, so that importing a module of this package costs no more than that module.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from models.surrogate.fan_surrogate import AdoptedEffect, Answer, FanSurrogate
    from models.surrogate.store import load, save_model

__all__ = ["AdoptedEffect", "Answer", "FanSurrogate", "load", "save_model"]

_HOMES = {
    "AdoptedEffect": "models.surrogate.fan_surrogate",
    "Answer": "models.surrogate.fan_surrogate",
    "FanSurrogate": "models.surrogate.fan_surrogate",
    "load": "models.surrogate.store",
    "save_model": "models.surrogate.store",
}


def __getattr__(name: str) -> Any:
    """Names of ``__all__``, imported on first use."""
    if name not in _HOMES:
        raise AttributeError(f"module 'models' has no attribute '{name}'")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
