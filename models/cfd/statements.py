"""Published statements about ducted fans near ground and wall, with the numbers of the flow simulation beside."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from models.cfd.assemble import Assembled, assemble, mesh_error
from models.cfd.case_run import Row
from models.cfd.config import Setup
from models.cfd.labels import HALF, Label, full_kind, kind_of, labels
from models.cfd.position import FREE, Place
from models.common.frames import Array

GROUND_LIMIT = 4.0
WALL_LIMIT = 3.8
"""Where the effects of ground and wall end, over R (corner-effect paper, sections 2.2 and 2.3)."""
AGREES = "agrees"
DISAGREES = "disagrees"
OPEN = "within uncertainty"


@dataclass(frozen=True)
class Statement:
    """What a publication says, which one, what these cases give, and whether that agrees."""

    claim: str
    source: str
    ours: str
    verdict: str


@dataclass(frozen=True, kw_only=True)
class Checked:
    """Everything that is reported, at the campaign's speed.

    ``labels``: the set's rows. ``parts`` (3,): lift of upper disc, lower disc and duct
    [N], of full models where they give the set's free air, else of half models. ``mesh`` (6,): error of an increment
    by the mesh [N, N m].
    """

    labels: dict[Place, Label]
    parts: dict[Place, Array]
    mesh: Array
    full: dict[Place, Label]
    half: dict[Place, Label]
    made: Assembled
    statements: tuple[Statement, ...] = ()

    @property
    def free(self) -> float:
        """Free lift [N]."""
        return float(self.labels[FREE].wrench[2])

    def ratio(self, h: float) -> float:
        """T_IGE / T_OGE at constant rotor speed."""
        return float(self.labels[h, math.inf].wrench[2]) / self.free

    @property
    def heights(self) -> list[float]:
        """Heights without a wall, over R, from the ground up."""
        return sorted(h for h, d in self.labels if math.isinf(d) and math.isfinite(h))

    @property
    def walls(self) -> list[float]:
        """Wall distances without ground, over R, the nearest first."""
        return sorted(d for h, d in self.labels if math.isinf(h) and math.isfinite(d))

    @property
    def corners(self) -> list[Place]:
        """Places with ground and wall."""
        return [(h, d) for h, d in self.labels if math.isfinite(h) and math.isfinite(d)]


def check(rows: Sequence[Row], setup: Setup) -> Checked:
    """Judge all cases. Raises ModelError where they do not give a set yet (see ``assemble``)."""
    made = assemble(rows, setup)
    rpm = setup.campaign.rpm
    kind = full_kind(rows, rpm)
    known: dict[Place, Label] = {}
    for (h_m, d_m, speed, *_), mark in zip(made.table.tolist(), made.marks, strict=True):
        if speed == rpm:
            place = round(h_m / setup.fan.radius_m, 9), round(d_m / setup.fan.radius_m, 9)
            known[place] = mark
    judged = kind if known[FREE].made == "solved" else HALF
    parts: dict[Place, Array] = {}
    for row in rows:
        p = row.position
        if kind_of(p) == judged and p.rpm == rpm and p.approach == "near":
            parts[p.place] = np.array(row.result.parts)
    bare = Checked(
        labels=known,
        parts=parts,
        mesh=mesh_error(rows, setup),
        full=labels(rows, rpm, kind),
        half=labels(rows, rpm),
        made=made,
    )
    return replace(bare, statements=tuple(_statements(bare)))


Judged = tuple[str, bool | None]
"""Our numbers, and whether they agree; None where the difference lies within the uncertainty."""
_JUDGES: list[tuple[str, str, Callable[[Checked], Judged]]] = []


_VERDICTS = {True: AGREES, False: DISAGREES, None: OPEN}


def _published(source: str, claim: str) -> Callable[[Callable[[Checked], Judged]], None]:
    """Register a function that judges one statement of a publication."""
    return lambda judge: _JUDGES.append((source, claim, judge))


def _statements(c: Checked) -> list[Statement]:
    """Those for which the positions are there."""
    out = []
    for source, claim, judge in _JUDGES:
        try:
            ours, holds = judge(c)
        except LookupError:  # a place that the campaign does not have
            continue
        out.append(Statement(claim, source, ours, _VERDICTS[holds]))
    return out


@_published("paper, figs 5 and 9", "lift ratio rises as the ground comes near")
def _ground_lifts(c: Checked) -> Judged:
    def doubt(h: float) -> float:
        return float(max(c.mesh[2], c.labels[h, math.inf].sigma[2])) / c.free

    falls = True
    for low, high in itertools.pairwise(c.heights):
        slack = math.hypot(doubt(low), doubt(high))
        falls = falls and c.ratio(high) <= c.ratio(low) + slack
    ours = [f"{c.ratio(h):.3f} at {h:g}" for h in c.heights]
    return f"{', '.join(ours)} R", falls


@_published("paper, section 2.2", "ground effect negligible from 4 R on (taken as 1 % of the lift)")
def _ground_ends(c: Checked) -> Judged:
    far = sorted((abs(c.ratio(h) - 1.0), h) for h in c.heights if h >= GROUND_LIMIT)
    size, h = far[-1]
    return f"{100 * (c.ratio(h) - 1):+.1f} % at {h:g} R", bool(size < 0.01 + c.mesh[2] / c.free)


@_published(
    "Zhou 2025",
    "+3.2 % for one ducted fan 1.6 R above ground at its exit (about h = 2.1 R); taken as 1 to 6 %",
)
def _measured_fan(c: Checked) -> Judged:
    if not c.heights:
        raise LookupError("no height without a wall")
    ratios = [c.ratio(h) for h in c.heights]
    gain = float(np.interp(2.1, c.heights, ratios)) - 1.0
    return f"{100 * gain:+.1f} % at 2.1 R", 0.01 <= gain <= 0.06


@_published("Zhao 2022, Zhou 2025", "near the ground the rotors' thrust rises and the duct's falls")
def _ground_shifts_load(c: Checked) -> Judged:
    h = c.heights[0]
    near = c.parts[h, math.inf]
    free = c.parts[FREE]
    rotor = near[:2].sum() / free[:2].sum()
    duct = near[2] / free[2]
    return f"rotors x {rotor:.2f}, duct x {duct:.2f} at {h:g} R", bool(rotor > 1 > duct)


@_published("paper, fig. 7", "the fan tilts towards the wall, more when nearer")
def _wall_tilts(c: Checked) -> Judged:
    tilts = [float(c.labels[math.inf, d].wrench[4]) for d in c.walls]
    ours = [f"{tilt:.3f} N m at {d:g}" for tilt, d in zip(tilts, c.walls, strict=True)]
    return f"{', '.join(ours)} R", tilts[0] == max(tilts) and min(tilts) > -c.mesh[4]


@_published("Conyers, Robinson", "the fan is drawn towards the wall")
def _wall_pulls(c: Checked) -> Judged:
    d = c.walls[0]
    pull = float(c.labels[math.inf, d].wrench[0])
    ours = f"{pull:.2f} N ({100 * pull / c.free:.1f} % of the lift) at {d:g} R"
    return ours, bool(pull > c.mesh[0])


@_published("paper, figs 6 and 10", "lift rises slightly near the wall")
def _wall_lifts(c: Checked) -> Judged:
    rises = [(c.labels[math.inf, d].wrench[2] / c.free - 1, d) for d in c.walls]
    rises.sort(key=lambda rise: abs(rise[0]))
    rise, d = rises[-1]
    mesh = c.mesh[2] / c.free
    ours = f"{100 * rise:+.2f} % at {d:g} R (mesh uncertainty {100 * mesh:.2f} %)"
    if abs(rise) <= mesh:
        return ours, None
    return ours, bool(0 < rise < 0.04)


@_published(
    "paper, section 2.3",
    "wall effect negligible from 3.8 R on (taken as 10 % of the nearest tilt, 0.5 % of the lift)",
)
def _wall_ends(c: Checked) -> Judged:
    d = next((d for d in c.walls if d >= WALL_LIMIT), math.nan)
    nearest = c.labels[math.inf, c.walls[0]].wrench[4]
    here = c.labels[math.inf, d].wrench
    lift = here[2] / c.free - 1
    excess = abs(here[4]) - 0.1 * nearest
    ours = f"tilt {100 * here[4] / nearest:.0f} %, lift {100 * lift:+.2f} % at {d:g} R"
    unsure = 0.0 <= excess < c.mesh[4] and abs(lift) < 0.005
    return ours, None if unsure else bool(excess < 0 and abs(lift) < 0.005)


@_published(
    "open rotor, Vertex 2025",
    "beside one wall the ground rules the lift (taken as: the wall changes it by less than 3 %)",
)
def _ground_rules(c: Checked) -> Judged:
    changes = []
    for h, d in c.corners:
        by_wall = c.labels[h, d].wrench[2] - c.labels[h, math.inf].wrench[2]
        changes.append((abs(by_wall) / c.free, h, d))
    most, h, d = sorted(changes)[-1]
    return f"at most {100 * most:.1f} %, at h = {h:g} R, d = {d:g} R", bool(most < 0.03)


@_published(
    "paper, section 2.4", "coefficients do not change regularly with distance in the corner"
)
def _corner_is_irregular(c: Checked) -> Judged:
    heights = sorted({h for h, _ in c.corners})
    if not heights:
        raise LookupError("no place with ground and wall")
    bent = [h for h in heights if _turns(c, h)]
    ours = f"lift or pull turns round in d at {len(bent)} of {len(heights)} heights"
    if bent:
        ours += f" ({', '.join([f'{h:g} R' for h in bent])})"
    return ours, bool(bent)


def _turns(c: Checked, h: float) -> bool:
    """Whether Fx or Fz over d, at one height, turns round by more than twice mesh noise and swing."""
    places = sorted(p for p in c.corners if p[0] == h)
    row = [c.labels[place] for place in places]
    for k in (0, 2):
        values = np.array([label.wrench[k] for label in row])
        swing = np.median([label.amplitude[k] for label in row])
        slack = 2 * max(float(c.mesh[k]), float(swing))
        fall = np.maximum.accumulate(values) - values
        rise = values - np.minimum.accumulate(values)
        if fall.max() > slack and rise.max() > slack:
            return True
    return False


@_published("paper, section 2.4", "the corner is more than ground and wall added")
def _corner_is_more(c: Checked) -> Judged:
    free = c.labels[FREE].wrench
    beyond = {}
    for h, d in c.corners:
        ground = c.labels[h, math.inf].wrench
        wall = c.labels[math.inf, d].wrench
        beyond[h, d] = c.labels[h, d].wrench - ground - wall + free
    h, d = sorted(beyond, key=lambda place: abs(beyond[place][0]))[-1]
    more = beyond[h, d]
    ours = f"pull {more[0]:+.2f} N, lift {more[2]:+.2f} N, tilt {more[4]:+.3f} N m beyond the sum"
    return f"{ours} at h = {h:g} R, d = {d:g} R", bool(abs(more[0]) > 2 * c.mesh[0])


@_published("Pereira 2008", "the duct carries 25 to 45 % of the lift of a small ducted fan")
def _duct_share(c: Checked) -> Judged:
    share = float(c.parts[FREE][2] / c.parts[FREE].sum())
    return f"{100 * share:.1f} %", 0.25 <= share <= 0.45


@_published("paper, eq. 1", "coefficients do not depend on rotor speed")
def _no_reynolds_number(c: Checked) -> Judged:
    law = c.made.law
    ours = (
        f"free lift grows as rpm^{2 + law.free:.3f}, increments of Fz as "
        f"rpm^{2 + law.exponent[2]:.2f}"
    )
    holds = abs(law.free) < 0.02 and abs(law.exponent[2]) < 2 * law.error[2] + 0.02
    return f"{ours} +- {law.error[2]:.2f}", bool(holds)


@_published("paper, table 2", "all six components respond to the corner")
def _six_components(c: Checked) -> Judged:
    free = c.full[FREE].wrench
    places = [p for p in c.full if p in c.half and p != FREE]
    side = sorted(abs(c.full[p].wrench[1]) for p in places)[-1]
    torque = sorted((c.full[p].wrench[5] for p in places), key=abs)[-1]
    ours = f"with swirl: side force up to {side:.2f} N, net torque up to {torque:+.3f} N m"
    return f"{ours} ({free[5]:+.3f} in free air)", bool(side > 2 * c.mesh[0])
