"""What the air does: data, training, surrogates, effects. Numerics only; no MAVLink.

``models.load(DIR)`` gives the surrogate of a fan, ``models.load()`` the shipped one; neither needs torch.
"""

from models.store import load, save_model
from models.surrogate import AdoptedEffect, Answer, FanSurrogate

__all__ = ["AdoptedEffect", "Answer", "FanSurrogate", "load", "save_model"]
