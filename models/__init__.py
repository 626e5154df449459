"""What the air does: data, training, surrogates, effects. Numerics only; no MAVLink.

``models.load(DIR)`` gives the surrogate of a fan, ``models.load()`` the shipped one; neither needs torch. Names are
looked up when first used, so that importing a module of this package costs no more than that module.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from models.lazy_exports import exports

if TYPE_CHECKING:
    from models.surrogate.fan_surrogate import FanSurrogate
    from models.surrogate.store import load, save_model
    from models.vehicle import Vehicle, load_vehicle

    __version__: str

__all__ = ["FanSurrogate", "Vehicle", "load", "load_vehicle", "save_model"]

_HOMES = {
    "FanSurrogate": "models.surrogate.fan_surrogate",
    "Vehicle": "models.vehicle",
    "load": "models.surrogate.store",
    "load_vehicle": "models.vehicle",
    "save_model": "models.surrogate.store",
}
__getattr__, __dir__ = exports(__name__, _HOMES)
