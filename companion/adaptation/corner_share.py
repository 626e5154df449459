"""How much of a law of walls is sent low beside a wall: as much as was measured there in this flight.

A law of a wall in the open says nothing of ground and wall together. There the pull falls and can
change its sign: in the flow simulation of the project 0.10 of the thrust at 3 radii above the ground
and 0.04 at 1.2, at half a radius from the wall; see also Ai, Xu, Xiang, Fan & Zhang 2020, Sensors
20(20), 5805, figures 8 to 10.

What is sent at a place with the weights r of the cells over ground: s = 1 - r' C r / r' K r. C is the
covariance of what the flight has measured there beside the law, K the same before the flight, both
where the wall in the open is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.adaptation.near_map import CELLS, GAPS, MAP
from companion.disturbance.records import FanPlaces
from models.common.frames import Array

LOW = CELLS - len(GAPS)
"""Cells over ground: those before the ones in the open."""
_NO_WALL = len(GAPS) - 1
"""Column of the cells that have no wall beside them."""


def low_covariance(cells: Array) -> Array:
    """(LOW, LOW) of the cells over ground where those in the open are known: A - B C^+ B'."""
    of_open = cells[LOW:, LOW:]
    shared = cells[:LOW, LOW:]
    out: Array = cells[:LOW, :LOW] - shared @ np.linalg.pinv(of_open, hermitian=True) @ shared.T
    return out


_BEFORE = low_covariance(MAP.covariance(1.0, of_wall=True))
"""Of a map of unit standard deviation."""


@dataclass(frozen=True, slots=True, eq=False)
class CornerShare:
    """Covariances (LOW, LOW) of level forces and of moments, over the prior variance of the map."""

    pull: Array
    tilt: Array

    def of_wrench(self, around: FanPlaces) -> Array:
        """(6,): the share of each part of a wrench, body FRD, where the fans are; the lift is left whole."""
        low = np.zeros(LOW)
        in_the_open = 0.0
        for height, gap, thrust in zip(
            around.heights, around.gaps, around.free_lift_n, strict=True
        ):
            for k, weight in MAP.cells(height, gap):
                if k % len(GAPS) == _NO_WALL:
                    continue
                if k < LOW:
                    low[k] += weight * thrust
                else:
                    in_the_open += weight * thrust
        over_ground = float(low.sum())
        if over_ground == 0.0:
            return np.ones(6)
        before = float(low @ _BEFORE @ low)

        def share(covariance: Array) -> float:
            known = min(max(1.0 - float(low @ covariance @ low) / before, 0.0), 1.0)
            return (in_the_open + over_ground * known) / (in_the_open + over_ground)

        pull = share(self.pull)
        tilt = share(self.tilt)
        return np.array((pull, pull, 1.0, tilt, tilt, pull))

    def moved(self, to: CornerShare, share: float) -> CornerShare:
        """This one, moved by a share of the way."""
        return CornerShare(
            self.pull + share * (to.pull - self.pull), self.tilt + share * (to.tilt - self.tilt)
        )


EVERYWHERE = CornerShare(np.zeros((LOW, LOW)), np.zeros((LOW, LOW)))
"""Of a law that knows the corner."""
