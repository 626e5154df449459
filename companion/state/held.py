"""The hold that flies, and what it must know to fly on."""

from __future__ import annotations

from dataclasses import dataclass

from companion.control.position_hold import Hold
from companion.control.position_target import Target
from companion.control.wall_distance import WallPlane
from companion.control.wall_guard import WallAhead
from companion.estimation.height_drift import NO_DRIFT, HeightDrift
from companion.estimation.wall_drift import NO_WALL_DRIFT, WallDrift


@dataclass(frozen=True, kw_only=True)
class Held:
    """The hold and its surroundings; all but ``left`` belong to a hold that flies."""

    hold: Hold | None = None
    left: tuple[Target, float] | None = None
    """Where a hold was to stay that was let go while nobody else took over, and when."""
    drift: HeightDrift = NO_DRIFT
    """Of the autopilot's height against the ground range."""
    wall_drift: WallDrift = NO_WALL_DRIFT
    """Of its position against the wall range."""
    wall_ahead: WallAhead | None = None
    """A wall that the held vehicle is driven to."""
    wall: WallPlane | None = None
    """The wall beside the hold."""
    target_wall_m: float = 0.0
    """How near to a wall it was last sent, where that was too near."""
