"""What the air does: data, training, surrogates, effects. Numerics only; no MAVLink.

``models.load(DIR)`` gives the surrogate of a fan, ``models.load()`` the shipped one; neither needs torch.
``models.train(DATA)`` makes one. Names are looked up when first used, so that importing a module of this package costs
no more than that module.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from models.common.lazy_exports import exports

if TYPE_CHECKING:
    from models.surrogate.store import load, save_model
    from models.training.library import train

    __version__: str

__all__ = ["load", "save_model", "train"]

_HOMES = {
    "load": "models.surrogate.store",
    "save_model": "models.surrogate.store",
    "train": "models.training.library",
}
__getattr__, __dir__ = exports(__name__, _HOMES)
