"""The side force that vanes exert in holding a moment off."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from models.common.frames import Rows
from models.vehicle import Vehicle


@lru_cache(maxsize=4)
def trim_reaction(vehicle: Vehicle) -> Rows:
    """Force per moment (3, 3) that the vanes exert in holding a moment off, [N] over [N m].

    A vane is a side force at its station. Balancing a wall's roll moment with vanes below the CG moves the vehicle
    towards that wall, with more force than the wall's own: 6.7 N per N m on the paper's vehicle.
    """
    axes = np.array([vane.axis for vane in vehicle.vanes]).T
    arms = np.cross([vane.position_m for vane in vehicle.vanes], axes.T).T
    first, second, third = map(tuple, (-axes @ np.linalg.pinv(arms)).tolist())
    return first, second, third
