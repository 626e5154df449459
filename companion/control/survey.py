"""Flies a box of heights and wall distances, slowly, so that one flight shows what ground and wall do to a vehicle.

A pure generator of position targets: plan once, then a place and a velocity for every instant. Its input is where the
vehicle is and how far ground and wall are; it begins and ends at the same place. Distances are those that the pilot
sees as cc_h and cc_d: the lowest fan's reference point over the ground, the nearest lip to the wall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from companion.mavlink.samples import LocalPosition, SetPositionTarget
from companion.survey_box import TRAVEL_M, SurveyBox
from models.evolve import replace
from models.frames import Array
from models.vehicle import Vector3

SPEED_M_S = 0.15
"""Mean speed of a move: the vehicle's own drag stays below what ground and wall do."""
DWELL_S = 3.0
"""At each place: ten times what the hold takes to come to rest."""
SETTLE_S = 3.0
"""For so long the hold must have been flying before the survey begins."""
HEIGHTS, DISTANCES = 5, 4
"""Places of the grid: enough to tell a decay length from a size."""
MARGIN_M = 0.06
"""Closer than the box by this, or by a third of the box's least distance: back to where it began at once."""
OFF_COURSE_M = 0.40
"""Further than this from where the survey wants the vehicle: back, too."""
_PLACE_AND_VELOCITY = 0x1C0 | 0x400 | 0x800
"""type_mask: acceleration, yaw and yaw rate are not commanded."""
_LOCAL_NED = 1
"""MAV_FRAME_LOCAL_NED."""
_PEAK = 1.875
"""Peak over mean speed of a minimum-jerk move."""


class Phase(Enum):
    """Where a survey is; the value is what the pilot reads."""

    WAITING = "waiting for the hold"
    FLYING = "survey under way"
    RETURNING = "going back to where it began"
    DONE = "survey done, holding where it began"
    ABORTED = "survey aborted by the pilot"


@dataclass(frozen=True)
class Leg:
    """Straight from one place to the next by minimum jerk, then stay: (height, wall distance) changes [m]."""

    start: tuple[float, float]
    end: tuple[float, float]
    move_s: float
    stay_s: float

    def at(self, t_s: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """Place and rate of change ``t_s`` into the leg."""
        if t_s >= self.move_s:
            return self.end, (0.0, 0.0)
        x = max(t_s, 0.0) / self.move_s
        share = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
        rate = 30.0 * x * x * (1.0 - x) ** 2 / self.move_s
        (a, b), (c, d) = self.start, self.end
        return (a + share * (c - a), b + share * (d - b)), (rate * (c - a), rate * (d - b))


@dataclass(frozen=True)
class Survey:
    """State of a survey. ``anchor`` (3,) NED is where it began; ``towards`` (2,) the level unit vector to the wall."""

    phase: Phase = Phase.WAITING
    engaged_s: float = math.inf
    started_s: float = math.inf
    anchor: Array | None = None
    towards: Array | None = None
    legs: tuple[Leg, ...] = ()
    leg: int = 0
    leg_s: float = math.inf
    """When the present leg began."""
    why: str = ""
    """Why it went back early, or did not begin."""

    @property
    def active(self) -> bool:
        """Whether it moves the hold."""
        return self.phase in (Phase.FLYING, Phase.RETURNING)

    def as_json(self) -> dict[str, object]:
        """What became of it."""
        flown = len(self.legs) if self.phase is Phase.DONE else self.leg
        return {"phase": self.phase.name.lower(), "why": self.why, "legs": len(self.legs), "legs_flown": flown}


@dataclass(frozen=True)
class Whereabouts:
    """What a survey needs to know: the vehicle's place (3,) NED, h and d [m] (inf: nothing there, nan: not known)."""

    t_s: float
    engaged: bool
    position: Array
    height_m: float
    wall_m: float
    towards: Array | None
    """Level unit vector (2,) to the wall."""


@dataclass(frozen=True)
class Wanted:
    """Place and velocity, NED (3,)."""

    position: Array
    velocity: Array


def level_direction(normal_ned: Vector3 | None) -> Array | None:
    """Unit vector (2,) of a wall's direction; None where it has none."""
    if normal_ned is None:
        return None
    size = math.hypot(normal_ned[0], normal_ned[1])
    return np.array(normal_ned[:2]) / size if size > 0.1 else None


def as_message(wanted: Wanted, heard: LocalPosition, component: int) -> SetPositionTarget:
    """The wish as the message that a pilot would send to ``component``, stamped like the position behind it."""
    n, e, d = map(float, wanted.position)
    vn, ve, vd = map(float, wanted.velocity)
    return SetPositionTarget(
        heard.t_s, heard.system, component, _PLACE_AND_VELOCITY, _LOCAL_NED, (n, e, d), (vn, ve, vd),
        (0.0, 0.0, 0.0), 0.0, 0.0, heard.system, component,
    )  # fmt: skip


def aborted(survey: Survey, why: str) -> Survey:
    """The pilot has taken over: the survey ends where it is and does not come back."""
    return replace(survey, phase=Phase.ABORTED, why=why) if survey.active else survey


def advance(survey: Survey, box: SurveyBox, seen: Whereabouts) -> tuple[Survey, Wanted | None]:
    """The survey at ``seen.t_s``, and where the hold is to be; None while it has no wish."""
    if survey.phase in (Phase.DONE, Phase.ABORTED):
        return survey, None
    if not seen.engaged:
        if survey.active:
            return aborted(survey, "the hold let go"), None
        return replace(survey, engaged_s=math.inf), None
    if survey.phase is Phase.WAITING:
        since = min(survey.engaged_s, seen.t_s)
        survey = replace(survey, engaged_s=since)
        return (survey if seen.t_s - since < SETTLE_S else _begin(survey, box, seen)), None
    if survey.phase is Phase.FLYING:
        survey = _watch(survey, box, seen)
    return _follow(survey, seen.t_s)


def _begin(survey: Survey, box: SurveyBox, seen: Whereabouts) -> Survey:
    refusal = _refusal(box, seen)
    if refusal:
        return replace(survey, why=refusal, engaged_s=seen.t_s)  # looks again
    towards = np.zeros(2) if seen.towards is None else seen.towards
    here = (seen.height_m, seen.wall_m if box.with_wall else 0.0)
    return replace(
        survey,
        phase=Phase.FLYING,
        started_s=seen.t_s,
        leg_s=seen.t_s,
        anchor=seen.position.copy(),
        towards=towards,
        legs=plan(box, here),
        why="",
    )


def _refusal(box: SurveyBox, seen: Whereabouts) -> str:
    if not math.isfinite(seen.height_m):
        return "the ground is not seen"
    if box.with_wall and (not math.isfinite(seen.wall_m) or seen.towards is None):
        return "the wall is not seen"
    if abs(seen.height_m - box.height_max_m) > TRAVEL_M or (
        box.with_wall and abs(seen.wall_m - box.wall_max_m) > TRAVEL_M
    ):
        return f"the box is more than {TRAVEL_M:g} m away"
    return ""


def plan(box: SurveyBox, here: tuple[float, float]) -> tuple[Leg, ...]:
    """Changes of (height, wall distance) from ``here``: down and up through the heights, from far to near the wall.

    Levels are closer together near a surface, where the air changes fastest. Between the columns it moves along the
    top of the box, and so on its way home.
    """
    heights = np.geomspace(box.height_min_m, box.height_max_m, HEIGHTS).tolist()
    distances = np.geomspace(box.wall_min_m, box.wall_max_m, DISTANCES).tolist() if box.with_wall else [here[1]]
    top = heights[-1]
    stops: list[tuple[float, float, float]] = [(top, here[1], 0.0)]
    for distance in reversed(distances):
        stops.append((top, distance, DWELL_S))
        stops += [(height, distance, DWELL_S) for height in reversed(heights[:-1])]
        stops.append((top, distance, DWELL_S))
    stops += [(top, here[1], 0.0), (*here, DWELL_S)]
    return _legs((0.0, 0.0), [(height - here[0], distance - here[1], stay_s) for height, distance, stay_s in stops])


def _legs(at: tuple[float, float], stops: list[tuple[float, float, float]]) -> tuple[Leg, ...]:
    """From ``at`` by way of ``stops``: changes of height and wall distance, and how long to stay there."""
    legs = []
    for rise, away, stay_s in stops:
        goal = (rise, away)
        length = math.dist(at, goal)
        if length > 1e-6 or stay_s > 0.0:
            legs.append(Leg(at, goal, max(_PEAK * length / SPEED_M_S, 0.5), stay_s))
        at = goal
    return tuple(legs)


def _watch(survey: Survey, box: SurveyBox, seen: Whereabouts) -> Survey:
    """Back to the beginning where a distance is under the box, out of sight, or the vehicle is not where it should be.

    On the way into the box from lower or nearer nothing is under it yet.
    """
    into_box = survey.leg == 0
    why = ""
    if math.isnan(seen.height_m) or (box.with_wall and math.isnan(seen.wall_m)):
        why = "a distance was lost"
    elif not into_box and seen.height_m < box.height_min_m - _margin(box.height_min_m):
        why = "too low"
    elif survey.leg > 1 and box.with_wall and seen.wall_m < box.wall_min_m - _margin(box.wall_min_m):
        why = "too close to the wall"
    else:
        wanted = _wanted(survey, seen.t_s)
        if float(np.linalg.norm(wanted.position - seen.position)) > OFF_COURSE_M:
            why = "the vehicle did not follow"
    return _turn_back(survey, seen, why) if why else survey


def _margin(least_m: float) -> float:
    return min(MARGIN_M, least_m / 3.0)


def _turn_back(survey: Survey, seen: Whereabouts, why: str) -> Survey:
    """From where it is: up and away from the wall, then home."""
    assert survey.anchor is not None
    assert survey.towards is not None
    off = seen.position - survey.anchor
    up, away = float(-off[2]), float(-(off[:2] @ survey.towards))
    top = max((leg.end[0] for leg in survey.legs), default=0.0)
    home: list[tuple[float, float, float]] = [
        (max(up, top), max(away, 0.0), 0.0),
        (max(up, top), 0.0, 0.0),
        (0.0, 0.0, DWELL_S),
    ]
    legs = _legs((up, away), home)
    return replace(survey, phase=Phase.RETURNING, legs=legs, leg=0, leg_s=seen.t_s, why=why)


def _follow(survey: Survey, t_s: float) -> tuple[Survey, Wanted]:
    leg = survey.legs[survey.leg]
    if t_s - survey.leg_s >= leg.move_s + leg.stay_s:
        if survey.leg + 1 == len(survey.legs):
            return replace(survey, phase=Phase.DONE), _wanted(survey, t_s)
        survey = replace(survey, leg=survey.leg + 1, leg_s=survey.leg_s + leg.move_s + leg.stay_s)
    return survey, _wanted(survey, t_s)


def _wanted(survey: Survey, t_s: float) -> Wanted:
    assert survey.anchor is not None
    assert survey.towards is not None
    (rise, away), (climb, leaving) = survey.legs[survey.leg].at(t_s - survey.leg_s)
    n, e = survey.towards
    position = survey.anchor + np.array([-n * away, -e * away, -rise])
    return Wanted(position, np.array([-n * leaving, -e * leaving, -climb]))
