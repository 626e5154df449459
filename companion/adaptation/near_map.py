"""What ground and wall do where no model is right: a form from the literature, and a map over height and distance."""

from __future__ import annotations

from dataclasses import dataclass

from companion.disturbance.about_cg import about_cg
from companion.disturbance.records import FanPlaces
from models.surface_map import SurfaceMap
from models.vehicle import Vehicle

MAP = SurfaceMap((0.8, 1.13, 1.6, 2.26, 3.2, 4.5), (0.35, 0.8, 1.6, 4.0))
"""Coarser than the one that diagnosis fits: a filter in flight carries a covariance of all cells."""
HEIGHTS = MAP.heights
GAPS = MAP.gaps
CELLS = MAP.size


def cheeseman_bennett(height_radii: float) -> float:
    """Lift that the ground adds, as a share of the lift in free air at equal power: 1 / (1 - (R / 4 z)^2) - 1.

    Cheeseman and Bennett 1955, ARC R&M 3021: a source under the ground. Valid above half a radius; nothing beyond 4.
    """
    if height_radii >= 4.0:
        return 0.0
    q = 1.0 / (4.0 * max(height_radii, 0.5)) ** 2
    return q / (1.0 - q)


@dataclass(frozen=True, slots=True)
class NearField:
    """Forces as shares of a fan's lift in free air, moments over that times the rotor radius.

    ``ground``: times Cheeseman and Bennett's lift. ``lift``, ``pull``, ``tilt``: (CELLS,), lift, attraction to the wall
    and moment that tilts towards it, beyond that and beyond the model's share.
    """

    ground: float
    lift: tuple[float, ...]
    pull: tuple[float, ...]
    tilt: tuple[float, ...]

    @property
    def is_nothing(self) -> bool:
        """Whether nothing was measured yet."""
        return self == NOTHING

    def at_fan(self, height_radii: float, gap_radii: float) -> tuple[float, float, float]:
        """Lift, pull and tilt at one fan, as shares."""
        if height_radii >= HEIGHTS[-1] and gap_radii >= GAPS[-1]:
            return 0.0, 0.0, 0.0
        lift = self.ground * cheeseman_bennett(height_radii)
        pull = 0.0
        tilt = 0.0
        for k, weight in MAP.cells(height_radii, gap_radii):
            lift += weight * self.lift[k]
            pull += weight * self.pull[k]
            tilt += weight * self.tilt[k]
        return lift, pull, tilt

    def wrenches(self, vehicle: Vehicle, around: FanPlaces) -> list[tuple[float, ...]]:
        """(fans, 6), corner frame: the same in N and N m."""
        out: list[tuple[float, ...]] = []
        for thrust, height, gap in zip(
            around.free_lift_n, around.heights, around.gaps, strict=True
        ):
            lift, pull, tilt = self.at_fan(height, gap)
            out.append(
                (
                    pull * thrust,
                    0.0,
                    lift * thrust,
                    0.0,
                    tilt * thrust * vehicle.rotor_radius_m,
                    0.0,
                )
            )
        return out

    def pull_change_n(self, around: FanPlaces, further_radii: float) -> float:
        """How much less all fans are drawn to the wall further off [N]."""
        out = 0.0
        for thrust, height, gap in zip(
            around.free_lift_n, around.heights, around.gaps, strict=True
        ):
            if gap < GAPS[-1]:
                out += thrust * self.at_fan(height, gap)[1]
                out -= thrust * self.at_fan(height, gap + further_radii)[1]
        return out

    def rows(self, vehicle: Vehicle, around: FanPlaces) -> list[list[float]]:
        """Lift, pull and tilt (3, 6) of all fans, body FRD about the CG."""
        return about_cg(vehicle, self.wrenches(vehicle, around), around.bearing_rad)


NOTHING = NearField(0.0, (0.0,) * CELLS, (0.0,) * CELLS, (0.0,) * CELLS)
"""Before anything is measured."""
