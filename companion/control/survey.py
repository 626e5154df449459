"""Flies a box of heights and wall distances, slowly, so that one flight shows what ground and wall do to a vehicle.

A pure generator of position targets: plan once, then a place and a velocity for every instant. Its input is where the
vehicle is and how far ground and wall are; it begins and ends at the same place. Distances are those that the pilot
sees as cc_h and cc_d: the lowest fan's reference point over the ground, the nearest lip to the wall.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

import numpy as np

from companion.mavlink.samples import LocalPosition, SetPositionTarget
from companion.survey_box import TRAVEL_M, SurveyBox
from models.common.frames import Array
from models.common.frozen_copy import with_changes

SPEED_M_S = 0.15
"""Mean speed of a move: the vehicle's own drag stays below what ground and wall do."""
DWELL_S = 3.0
"""At each place: ten times what the hold takes to come to rest."""
SETTLE_S = 3.0
"""For so long the hold must have been flying before the survey begins."""
HEIGHTS = 5
DISTANCES = 4
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
class SurveyLeg:
    """Straight from one place to the next by minimum jerk, then stay: (height, wall distance) changes [m]."""

    start: tuple[float, float]
    end: tuple[float, float]
    move_s: float
    stay_s: float

    def at(self, t_s: float) -> tuple[Array, Array]:
        """Place (2,) and rate of change (2,) ``t_s`` into the leg."""
        x = min(max(t_s / self.move_s, 0.0), 1.0)
        share = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
        rate = 30.0 * x * x * (1.0 - x) ** 2 / self.move_s
        start = np.array(self.start)
        way = np.subtract(self.end, self.start)
        return start + share * way, rate * way


_ORIGIN = np.zeros(3)
_NO_AXES = np.zeros((2, 3))


@dataclass(frozen=True)
class Survey:
    """State of a survey."""

    phase: Phase = Phase.WAITING
    since_s: float = math.inf
    """When the hold engaged; on the way, when the present leg began."""
    anchor: Array = field(default_factory=lambda: _ORIGIN)
    """Where it began, NED."""
    axes: Array = field(default_factory=lambda: _NO_AXES)
    """Unit vectors up and away from the wall, NED."""
    legs: tuple[SurveyLeg, ...] = ()
    leg: int = 0
    why: str = ""
    """Why it went back early, or did not begin."""

    @property
    def active(self) -> bool:
        """Whether it moves the hold."""
        return self.phase in (Phase.FLYING, Phase.RETURNING)

    def wanted(self, t_s: float) -> SurveyTarget:
        """Where the hold is to be."""
        place, rate = self.legs[self.leg].at(t_s - self.since_s)
        return SurveyTarget(self.anchor + place @ self.axes, rate @ self.axes)

    def as_json(self) -> dict[str, object]:
        """What became of it."""
        if self.phase is Phase.DONE:
            flown = len(self.legs)
        else:
            flown = self.leg
        return {
            "phase": self.phase.name.lower(),
            "why": self.why,
            "legs": len(self.legs),
            "legs_flown": flown,
        }


@dataclass(frozen=True, kw_only=True)
class Whereabouts:
    """What a survey needs to know: the vehicle's place (3,) NED, h and d [m] (inf: nothing there, nan: not known)."""

    t_s: float
    engaged: bool
    position: Array
    height_m: float
    wall_m: float
    towards: Sequence[float] | None
    """Level unit vector (2,) to the wall."""


class SurveyTarget(NamedTuple):
    """Place and velocity, NED (3,)."""

    position: Array
    velocity: Array


def as_message(wanted: SurveyTarget, heard: LocalPosition, component: int) -> SetPositionTarget:
    """The wish as the message that a pilot would send to ``component``, stamped like the position behind it."""
    n, e, d = map(float, wanted.position)
    vn, ve, vd = map(float, wanted.velocity)
    return SetPositionTarget(
        heard.t_s,
        heard.system,
        component,
        type_mask=_PLACE_AND_VELOCITY,
        frame=_LOCAL_NED,
        position=(n, e, d),
        velocity=(vn, ve, vd),
        acceleration=(0.0, 0.0, 0.0),
        yaw=0.0,
        target_system=heard.system,
        target_component=component,
    )


def aborted(survey: Survey, why: str) -> Survey:
    """The pilot has taken over: the survey ends where it is and does not come back."""
    if survey.active:
        return with_changes(survey, phase=Phase.ABORTED, why=why)
    return survey


def advance(
    survey: Survey, box: SurveyBox, seen: Whereabouts
) -> tuple[Survey, SurveyTarget | None]:
    """The survey at ``seen.t_s``, and where the hold is to be; None while it has no wish."""
    if survey.phase in (Phase.DONE, Phase.ABORTED):
        return survey, None
    if not seen.engaged:
        return aborted(survey, "the hold let go") if survey.active else with_changes(
            survey, since_s=math.inf
        ), None
    if survey.phase is Phase.WAITING:
        survey = with_changes(survey, since_s=min(survey.since_s, seen.t_s))
        return survey if seen.t_s - survey.since_s < SETTLE_S else _begun(survey, box, seen), None
    if survey.phase is Phase.FLYING:
        why = _danger(survey, box, seen)
    else:
        why = ""
    if why:
        survey = _turned_back(survey, seen, why)
    leg = survey.legs[survey.leg]
    end_s = survey.since_s + leg.move_s + leg.stay_s
    if seen.t_s >= end_s and survey.leg + 1 == len(survey.legs):
        survey = with_changes(survey, phase=Phase.DONE)
    elif seen.t_s >= end_s:
        survey = with_changes(survey, leg=survey.leg + 1, since_s=end_s)
    return survey, survey.wanted(seen.t_s)


def _begun(survey: Survey, box: SurveyBox, seen: Whereabouts) -> Survey:
    """On its way, or after another look at what it needs to see."""
    far = abs(seen.height_m - box.height_max_m) > TRAVEL_M
    why = ""
    if not math.isfinite(seen.height_m):
        why = "the ground is not seen"
    elif box.with_wall and (not math.isfinite(seen.wall_m) or seen.towards is None):
        why = "the wall is not seen"
    elif far or (box.with_wall and abs(seen.wall_m - box.wall_max_m) > TRAVEL_M):
        why = f"the box is more than {TRAVEL_M:g} m away"
    if why:
        return with_changes(survey, why=why, since_s=seen.t_s)
    n, e = (0.0, 0.0) if seen.towards is None else seen.towards
    legs = plan(box, (seen.height_m, seen.wall_m if box.with_wall else 0.0))
    axes = np.array([[0.0, 0.0, -1.0], [-n, -e, 0.0]])
    return Survey(Phase.FLYING, seen.t_s, seen.position.copy(), axes, legs)


def plan(box: SurveyBox, here: tuple[float, float]) -> tuple[SurveyLeg, ...]:
    """Changes of (height, wall distance) from ``here``: down and up through the heights, from far to near the wall.

    Levels are closer together near a surface, where the air changes fastest. Between the columns it moves along the
    top of the box, and so on its way home.
    """
    heights = np.geomspace(box.height_min_m, box.height_max_m, HEIGHTS).tolist()
    if box.with_wall:
        distances = np.geomspace(box.wall_min_m, box.wall_max_m, DISTANCES).tolist()
    else:
        distances = [here[1]]
    top = heights[-1]
    stops: list[Stop] = [(top, here[1], 0.0)]
    for distance in reversed(distances):
        stops += [(height, distance, DWELL_S) for height in (*reversed(heights), top)]
    stops += [(top, here[1], 0.0), (*here, DWELL_S)]
    return _legs(
        (0.0, 0.0),
        [(height - here[0], distance - here[1], stay_s) for height, distance, stay_s in stops],
    )


Stop = tuple[float, float, float]
"""Height, wall distance, and how long to stay."""


def _legs(at: tuple[float, float], stops: list[Stop]) -> tuple[SurveyLeg, ...]:
    """From ``at`` by way of ``stops``, which are changes of height and wall distance."""
    legs = []
    for rise, away, stay_s in stops:
        length = math.dist(at, (rise, away))
        if length > 1e-6 or stay_s > 0.0:
            legs.append(SurveyLeg(at, (rise, away), max(_PEAK * length / SPEED_M_S, 0.5), stay_s))
        at = (rise, away)
    return tuple(legs)


def _danger(survey: Survey, box: SurveyBox, seen: Whereabouts) -> str:
    """Why to go back: a distance is under the box, out of sight, or the vehicle is not where it should be.

    On the way into the box from lower or nearer nothing is under it yet.
    """
    if math.isnan(seen.height_m) or (box.with_wall and math.isnan(seen.wall_m)):
        return "a distance was lost"
    if survey.leg > 0 and seen.height_m < box.height_min_m - _margin(box.height_min_m):
        return "too low"
    if survey.leg > 1 and box.with_wall and seen.wall_m < box.wall_min_m - _margin(box.wall_min_m):
        return "too close to the wall"
    off_m = np.linalg.norm(survey.wanted(seen.t_s).position - seen.position)
    if off_m > OFF_COURSE_M:
        return "the vehicle did not follow"
    return ""


def _margin(least_m: float) -> float:
    return min(MARGIN_M, least_m / 3.0)


def _turned_back(survey: Survey, seen: Whereabouts, why: str) -> Survey:
    """From where it is: up and away from the wall, then home."""
    up, away = (survey.axes @ (seen.position - survey.anchor)).tolist()
    top = max(up, *(leg.end[0] for leg in survey.legs))
    home = _legs((up, away), [(top, max(away, 0.0), 0.0), (top, 0.0, 0.0), (0.0, 0.0, DWELL_S)])
    return with_changes(survey, phase=Phase.RETURNING, legs=home, leg=0, since_s=seen.t_s, why=why)
