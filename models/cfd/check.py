"""Is the set credible? Convergence, mesh study, and the statements of paper and literature with our numbers beside."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from models.cfd.assemble import Assembled, Law, assemble, ceilings, correction, fit_law
from models.cfd.campaign import Row
from models.cfd.config import Setup
from models.cfd.fidelity import FREE, Correction
from models.cfd.grid import Study, spread
from models.cfd.labels import HALF, Kind, Label, full_kind, kind_of, labels
from models.cfd.position import Place
from models.errors import ModelError
from models.frames import AXES, Array

GROUND_LIMIT, WALL_LIMIT = 4.0, 3.8
"""Where the effects of ground and wall end, over R (corner-effect paper, sections 2.2 and 2.3)."""
LIP_SUCTION = {0.5: 1.72e-3, 1.0: 1.09e-3, 2.0: 0.44e-3}
"""C_My over d / R of an estimate: the lip's suction is lost on the side that the wall shields."""
AGREES, DISAGREES, OPEN = "agrees", "disagrees", "within uncertainty"


@dataclass(frozen=True)
class Statement:
    """What somebody says, who, what these cases give, and whether that agrees."""

    claim: str
    source: str
    ours: str
    verdict: str


@dataclass(frozen=True)
class Checked:
    """Everything ``models cfd check`` reports, at the campaign's speed.

    ``labels``: the set's rows, their ``error`` the row's sigma; ``made`` how each was made (see ``assemble.Mark``).
    ``half`` and ``full``: labels of each model alone. ``parts`` (3,): lift of upper disc, lower disc and duct [N], of
    full models where they give the set's ground column, else of half models.
    """

    labels: dict[Place, Label]
    made: dict[Place, str]
    half: dict[Place, Label]
    full: dict[Place, Label]
    parts: dict[Place, Array]
    study: Study
    law: Law | None
    full_law: Law | None
    statements: tuple[Statement, ...]
    correction: Correction
    ceilings: tuple[Array, Array] | None
    summary: dict[str, Any]
    force_unit: float
    moment_unit: float
    """rho A Omega^2 R^2 and rho A Omega^2 R^3 at the campaign's speed, A the area of one disc."""

    @property
    def free(self) -> float:
        """Free lift [N]."""
        return float(self.labels[FREE].wrench[2])

    def ratio(self, h: float) -> float:
        """T_IGE / T_OGE at constant rotor speed."""
        return float(self.labels[h, math.inf].wrench[2]) / self.free


def check(rows: Sequence[Row], setup: Setup) -> Checked:
    """Judge all cases. Raises ModelError where free air is missing: nothing can be said without it."""
    c = setup.campaign
    half, kind = labels(rows, c.rpm), full_kind(rows, c.rpm)
    if FREE not in half:
        raise ModelError(f"the cases lack free air (h = inf, d = inf) at {c.rpm:g} rpm; run the campaign on")
    omega = c.rpm * 2 * math.pi / 60
    tip_pressure = setup.air.density_kg_m3 * math.pi * setup.fan.radius_m**2 * (omega * setup.fan.radius_m) ** 2
    solved = {rpm: labels(rows, rpm) for rpm in (c.rpm, *c.other_rpm)}
    speeds = {rpm: found for rpm, found in solved.items() if FREE in found}
    law = fit_law(speeds, c.rpm) if len(speeds) > 1 else None
    full = labels(rows, c.rpm, kind)
    whole = assemble(rows, setup) if len(speeds) == 1 + len(c.other_rpm) and law is not None else None
    known, made = (half, dict.fromkeys(half, "half")) if whole is None else _of_set(whole, setup)
    bare = Checked(
        labels=known,
        made=made,
        half=half,
        full=full,
        parts=_parts(rows, c.rpm, kind if made[FREE].startswith("solved") else HALF),
        study=spread(rows, setup),
        law=law,
        full_law=_full_law(rows, setup, kind),
        statements=(),
        correction=correction(full, half),
        ceilings=ceilings(whole) if whole is not None else None,
        summary={},
        force_unit=tip_pressure,
        moment_unit=tip_pressure * setup.fan.radius_m,
    )
    said = tuple(_statements(bare))
    return replace(bare, statements=said, summary=_summary(rows, bare, said))


def _full_law(rows: Sequence[Row], setup: Setup, kind: Kind) -> Law | None:
    """The law of rotor speed of full models alone; None without free air and a position at another speed."""
    c = setup.campaign
    speeds = {rpm: labels(rows, rpm, kind) for rpm in (c.rpm, *c.other_rpm)}
    speeds = {rpm: found for rpm, found in speeds.items() if FREE in found}
    others = [p for rpm, found in speeds.items() if rpm != c.rpm for p in found if p != FREE]
    return fit_law(speeds, c.rpm) if c.rpm in speeds and others else None


def _of_set(whole: Assembled, setup: Setup) -> tuple[dict[Place, Label], dict[Place, str]]:
    """Labels and making of the set's rows at the campaign's speed."""
    out, made = {}, {}
    for row, mark in zip(whole.table, whole.marks, strict=True):
        if row[2] == setup.campaign.rpm:
            h, d = (round(float(v) / setup.fan.radius_m, 9) for v in row[:2])
            out[h, d] = Label(row[3:], mark.amplitude, mark.sigma, mark.status, mark.starts)
            made[h, d] = mark.even
    return out, made


def _parts(rows: Sequence[Row], rpm: float, kind: Kind) -> dict[Place, Array]:
    """Lift (3,) of upper disc, lower disc and duct [N] by place, of one kind of case."""
    usual = (r for r in rows if kind_of(r.position) == kind and (r.position.rpm, r.position.approach) == (rpm, "near"))
    return {r.position.place: np.array(r.result.parts) for r in usual}


def _summary(rows: Sequence[Row], c: Checked, said: Sequence[Statement]) -> dict[str, Any]:
    """The figures a program reads."""
    half = [r for r in rows if r.position.model == "half"]
    usual = [r.result for r in half if r.position.level == 1.0]
    swing = np.array([label.amplitude for label in c.labels.values()])
    return {
        "cases": len(rows),
        "models": dict(Counter(r.position.model for r in rows)),
        "positions": len(c.labels),
        "made": dict(Counter(c.made.values())),
        "status": dict(Counter(r.result.status for r in rows)),
        "usable": sum(r.usable for r in rows),
        "cpu_hours": sum(r.result.seconds for r in rows) / 3600,
        "seconds_per_half_case": _quartiles([r.seconds for r in usual]),
        "cells_per_half_case": _quartiles([float(r.cells) for r in usual]),
        "free_lift_N": c.free,
        "C_T": c.free / c.force_unit,
        "uncertainty": {
            "mesh_total": _by_axis(c.study.total),
            "mesh_increment": _by_axis(c.study.increment),
            "unsteadiness_and_branch_median": _by_axis(np.median(swing, axis=0)),
            "unsteadiness_and_branch_most": _by_axis(swing.max(axis=0)),
            "note": "Fy, Mx, Mz are zero by symmetry in the half model; mesh numbers are half-spreads over the levels",
        },
        "mesh_levels": list(c.study.levels),
        "rpm_law": _law(c.law),
        "rpm_law_of_full_models": _law(c.full_law),
        "fidelity": {
            "full_models": len(c.full),
            "half_model_misses": _by_axis(c.correction.plain),
            "corrected_misses": _by_axis(c.correction.error),
            "learnt": [a for a, learnt in zip(AXES, c.correction.learnt, strict=True) if learnt],
        },
        "r2_ceiling": _ceilings(c.ceilings),
        "agreement": [asdict(s) for s in said],
        "verdicts": dict(Counter(s.verdict for s in said)),
    }


def _law(law: Law | None) -> dict[str, Any] | None:
    if law is None:
        return None
    return {
        "free_lift_exponent": 2 + law.free,
        "increment_exponent": _by_axis(2 + law.exponent, odd=False),
        "standard_error": _by_axis(law.error, odd=False),
        "left_rms": _by_axis(law.left, odd=False),
        "positions": law.positions,
    }


def _ceilings(found: tuple[Array, Array] | None) -> dict[str, dict[str, float | None]] | None:
    if found is None:
        return None
    return dict(zip(("rows", "full_models"), (_by_axis(v) for v in found), strict=True))


def _quartiles(values: Sequence[float]) -> list[float]:
    return [float(v) for v in np.quantile(values, (0.25, 0.5, 0.75))] if values else []


def _by_axis(values: Array, odd: bool = True) -> dict[str, float | None]:
    """By name of the axis; None where a number is not known."""
    known = [float(v) if math.isfinite(v) else None for v in values]
    return {a: v for k, (a, v) in enumerate(zip(AXES, known, strict=True)) if odd or k % 2 == 0}


def _statements(c: Checked) -> list[Statement]:
    """Those for which the positions are there."""
    out: list[Statement] = []
    heights = sorted(h for h, d in c.labels if math.isinf(d) and math.isfinite(h))
    walls = sorted(d for h, d in c.labels if math.isinf(h) and math.isfinite(d))
    noise = c.study.increment
    if len(heights) >= 3:
        out += _ground(c, heights, float(noise[2]) / c.free)
    if len(walls) >= 3:
        out += _wall(c, walls, noise)
    corners = [(h, d) for h, d in c.labels if math.isfinite(h) and math.isfinite(d)]
    if corners and heights and walls:
        out += _corner(c, corners, noise)
    out += _fan(c)
    return out


def _verdict(holds: bool) -> str:
    return AGREES if holds else DISAGREES


def _ground(c: Checked, heights: list[float], noise: float) -> list[Statement]:
    ratios = {h: c.ratio(h) for h in heights}
    doubt = {h: max(noise, float(c.labels[h, math.inf].error[2]) / c.free) for h in heights}
    falls = all(ratios[b] <= ratios[a] + math.hypot(doubt[a], doubt[b]) for a, b in itertools.pairwise(heights))
    listed = ", ".join(f"{ratios[h]:.3f} at {h:g}" for h in heights)
    out = [
        Statement("lift ratio rises as the ground comes near", "paper, figs 5 and 9", listed + " R", _verdict(falls)),
    ]
    far = [h for h in heights if h >= GROUND_LIMIT]
    if far:
        worst = max((abs(ratios[h] - 1.0), h) for h in far)
        out.append(
            Statement(
                "ground effect negligible from 4 R on (taken as 1 % of the lift)",
                "paper, section 2.2",
                f"{100 * (ratios[worst[1]] - 1):+.1f} % at {worst[1]:g} R",
                _verdict(worst[0] < 0.01 + noise),
            )
        )
    at = float(np.interp(2.1, heights, [ratios[h] for h in heights]))
    out.append(
        Statement(
            "+3.2 % for one ducted fan 1.6 R above ground at its exit (about h = 2.1 R); taken as 1 to 6 %",
            "Zhou 2025",
            f"{100 * (at - 1):+.1f} % at 2.1 R",
            _verdict(0.01 <= at - 1 <= 0.06),
        )
    )
    estimates = ((1.0, 1.10, 0.04), (1.5, 1.057, 0.025), (2.0, 1.033, 0.015), (3.0, 1.010, 0.008))
    inside = [(h, abs(ratios[h] - e) <= s) for h, e, s in estimates if h in ratios]
    out.append(
        Statement(
            "1.10 at 1 R, 1.057 at 1.5 R, 1.033 at 2 R, 1.010 at 3 R, within the estimate's own range",
            "engineering estimate for this fan",
            ", ".join(f"{ratios[h]:.3f} at {h:g} R" for h, _ in inside),
            _verdict(all(ok for _, ok in inside)),
        )
    )
    h = heights[0]
    if (h, math.inf) in c.parts and FREE in c.parts:
        rotor = c.parts[h, math.inf][:2].sum() / c.parts[FREE][:2].sum()
        duct = c.parts[h, math.inf][2] / c.parts[FREE][2]
        out.append(
            Statement(
                "near the ground the rotors' thrust rises and the duct's falls",
                "Zhao 2022, Zhou 2025",
                f"rotors x {rotor:.2f}, duct x {duct:.2f} at {h:g} R",
                _verdict(rotor > 1 > duct),
            )
        )
    return out


def _wall(c: Checked, walls: list[float], noise: Array) -> list[Statement]:
    at = {d: c.labels[math.inf, d].wrench for d in walls}
    lift = {d: 100 * (at[d][2] / c.free - 1) for d in walls}
    near = walls[0]
    tilt = [at[d][4] for d in walls]
    out = [
        Statement(
            "the fan tilts towards the wall, more when nearer",
            "paper, fig. 7",
            ", ".join(f"{at[d][4]:.3f} N m at {d:g}" for d in walls) + " R",
            _verdict(tilt[0] == max(tilt) and all(t > -noise[4] for t in tilt)),
        ),
        Statement(
            "the fan is drawn towards the wall",
            "Conyers, Robinson",
            f"{at[near][0]:.2f} N ({100 * at[near][0] / c.free:.1f} % of the lift) at {near:g} R",
            _verdict(at[near][0] > noise[0]),
        ),
    ]
    rise = max(lift.items(), key=lambda item: abs(item[1]))
    sure = abs(rise[1]) > 100 * noise[2] / c.free
    out.append(
        Statement(
            "lift rises slightly near the wall",
            "paper, figs 6 and 10",
            f"{rise[1]:+.2f} % at {rise[0]:g} R (mesh uncertainty {100 * noise[2] / c.free:.2f} %)",
            OPEN if not sure else _verdict(0 < rise[1] < 4),
        )
    )
    return [*out, *_wall_far(c, walls, noise), *_wall_size(c, walls)]


def _wall_far(c: Checked, walls: list[float], noise: Array) -> list[Statement]:
    """Where the wall's effect ends."""
    far = [d for d in walls if d >= WALL_LIMIT]
    if not far:
        return []
    d = far[0]
    nearest, here = c.labels[math.inf, walls[0]].wrench[4], c.labels[math.inf, d].wrench
    tilt, lift = abs(here[4]), 100 * (here[2] / c.free - 1)
    most = 0.1 * nearest
    open_ = most <= tilt < most + noise[4] and abs(lift) < 0.5
    return [
        Statement(
            "wall effect negligible from 3.8 R on (taken as 10 % of the nearest tilt, 0.5 % of the lift)",
            "paper, section 2.3",
            f"tilt {100 * here[4] / nearest:.0f} %, lift {lift:+.2f} % at {d:g} R",
            OPEN if open_ else _verdict(tilt < most and abs(lift) < 0.5),
        )
    ]


def _wall_size(c: Checked, walls: list[float]) -> list[Statement]:
    """The size of the tilting moment."""
    ours = {d: float(c.labels[math.inf, d].wrench[4]) / c.moment_unit for d in LIP_SUCTION if d in walls}
    if not ours:
        return []
    return [
        Statement(
            "C_My 1.72e-3 at 0.5 R, 1.09e-3 at 1 R, 0.44e-3 at 2 R, each within x 0.4 to x 2",
            "lip suction estimate",
            ", ".join(f"{1e3 * v:.2f}e-3 at {d:g} R" for d, v in ours.items()),
            _verdict(all(0.4 <= v / LIP_SUCTION[d] <= 2 for d, v in ours.items())),
        )
    ]


def _corner(c: Checked, corners: list[Place], noise: Array) -> list[Statement]:
    out = []
    gain = [
        (abs(c.labels[p].wrench[2] - c.labels[p[0], math.inf].wrench[2]) / c.free, p)
        for p in corners
        if (p[0], math.inf) in c.labels
    ]
    if gain:
        most, place = max(gain)
        out.append(
            Statement(
                "beside one wall the ground rules the lift (taken as: the wall changes it by less than 3 %)",
                "open rotor, Vertex 2025",
                f"at most {100 * most:.1f} %, at h = {place[0]:g} R, d = {place[1]:g} R",
                _verdict(most < 0.03),
            )
        )
    turns = {h: _turns(c, h, noise) for h in sorted({h for h, _ in corners})}
    bent = [h for h, n in turns.items() if n]
    out.append(
        Statement(
            "coefficients do not change regularly with distance in the corner",
            "paper, section 2.4",
            f"lift or pull turns round in d at {len(bent)} of {len(turns)} heights"
            + (f" ({', '.join(f'{h:g} R' for h in bent)})" if bent else ""),
            _verdict(bool(bent)),
        )
    )
    extra = []
    for h, d in corners:
        if (h, math.inf) in c.labels and (math.inf, d) in c.labels:
            sum_ = c.labels[h, math.inf].wrench + c.labels[math.inf, d].wrench - c.labels[FREE].wrench
            beyond = c.labels[h, d].wrench - sum_
            extra.append((abs(beyond[0]) / c.free, beyond, (h, d)))
    if extra:
        size, beyond, (h, d) = max(extra, key=lambda e: e[0])
        out.append(
            Statement(
                "the corner is more than ground and wall added",
                "paper, section 2.4",
                f"pull {beyond[0]:+.2f} N, lift {beyond[2]:+.2f} N, tilt {beyond[4]:+.3f} N m beyond the sum "
                f"at h = {h:g} R, d = {d:g} R",
                _verdict(size * c.free > 2 * noise[0]),
            )
        )
    return out


def _turns(c: Checked, h: float, noise: Array) -> bool:
    """Whether Fx or Fz over d, at one height, turns round by more than twice mesh noise and swing."""
    row = [(d, c.labels[h, d]) for d in sorted(d for hh, d in c.labels if hh == h and math.isfinite(d))]
    for k in (0, 2):
        values = np.array([label.wrench[k] for _, label in row])
        slack = 2 * max(float(noise[k]), float(np.median([label.amplitude[k] for _, label in row])))
        up = np.maximum.accumulate(values) - values
        down = values - np.minimum.accumulate(values)
        if up.max() > slack and down.max() > slack:
            return True
    return False


def _fan(c: Checked) -> list[Statement]:
    out = []
    if FREE in c.parts:
        share = float(c.parts[FREE][2] / c.parts[FREE].sum())
        out.append(
            Statement(
                "the duct carries 25 to 45 % of the lift of a small ducted fan",
                "Pereira 2008",
                f"{100 * share:.1f} %",
                _verdict(0.25 <= share <= 0.45),
            )
        )
    if c.law is not None:
        out.append(
            Statement(
                "coefficients do not depend on rotor speed",
                "paper, eq. 1",
                f"free lift grows as rpm^{2 + c.law.free:.3f}, increments of Fz as rpm^{2 + c.law.exponent[2]:.2f} "
                f"+- {c.law.error[2]:.2f}",
                _verdict(abs(c.law.free) < 0.02 and abs(c.law.exponent[2]) < 2 * c.law.error[2] + 0.02),
            )
        )
    pairs = [(c.full[p].wrench, c.half[p].wrench) for p in c.full if p in c.half and p != FREE]
    if pairs and FREE in c.full:
        side = max(abs(w[1]) for w, _ in pairs)
        change = max(abs(w[4] - half[4]) for w, half in pairs)
        torque = max((w[5] for w, _ in pairs), key=abs)
        out.append(
            Statement(
                "all six components respond to the corner",
                "paper, table 2",
                f"with swirl: side force up to {side:.2f} N, net torque up to {torque:+.3f} N m "
                f"({c.full[FREE].wrench[5]:+.3f} in free air), tilt changed by up to {change:.3f} N m",
                _verdict(side > 2 * float(c.study.increment[0])),
            )
        )
    return out


def text(c: Checked) -> str:
    """The report in words."""
    s = c.summary
    models = ", ".join(f"{n} {model}" for model, n in s["models"].items())
    unit = ("N", "N", "N", "N m", "N m", "N m")
    lines = [
        f"{s['cases']} cases ({models}), {s['positions']} positions at the campaign's speed, {s['usable']} stand still "
        f"or have a known mean, {s['cpu_hours']:.1f} hours in the solver: "
        + ", ".join(f"{n} {k}" for k, n in s["status"].items()),
        f"free lift {c.free:.2f} N, C_T {s['C_T']:.4f} (trimmed, no evidence)",
    ]
    if s["seconds_per_half_case"]:
        q, n = s["seconds_per_half_case"], s["cells_per_half_case"]
        lines.append(f"half case: {q[1]:.0f} s (quartiles {q[0]:.0f}, {q[2]:.0f}), {n[1]:.0f} cells")
    lines.append(f"{'uncertainty':14}" + "".join(f"{a + ' ' + u:>10}" for a, u in zip(AXES, unit, strict=True)))
    rows = s["uncertainty"]
    for key, name in (
        ("mesh_total", "mesh, total"),
        ("mesh_increment", "mesh, added"),
        ("unsteadiness_and_branch_median", "moves, median"),
        ("unsteadiness_and_branch_most", "moves, most"),
    ):
        lines.append(f"{name:14}" + "".join(f"{rows[key][a]:10.4f}" for a in AXES))
    lines += _law_lines(s)
    if c.correction.places:
        learnt = ", ".join(s["fidelity"]["learnt"]) or "nothing"
        lines.append(
            f"full models at {len(c.correction.places)} places and in free air; half models alone miss their "
            "increments by "
            + _listed(c.correction.plain)
            + f"; corrected and left out by {_listed(c.correction.error)}; "
            f"learnt: {learnt}"
        )
    if c.ceilings is not None:
        for ceiling, against in zip(c.ceilings, ("against these rows", "against full models"), strict=True):
            by = ", ".join(f"{a} {v:.3f}" for a, v in zip(AXES, ceiling, strict=True))
            lines.append(f"R2 of increments that a perfect surrogate of this set reaches {against}: {by}")
    lines.append("")
    for said in c.statements:
        lines.append(f"[{said.verdict}] {said.claim} ({said.source}): {said.ours}")
    return "\n".join(lines)


def _law_lines(summary: dict[str, Any]) -> list[str]:
    """How lift and increments grow with rotor speed, of half models and of full ones where they were computed."""
    lines = []
    for key, models in (("rpm_law", "half models"), ("rpm_law_of_full_models", "full models")):
        law = summary[key]
        if law is None:
            continue
        by = ", ".join(f"{a} {law['increment_exponent'][a]:.2f} +- {law['standard_error'][a]:.2f}" for a in AXES[::2])
        lines.append(
            f"rotor speed, {models}: free lift as rpm^{law['free_lift_exponent']:.3f}, increments of {by} "
            f"({law['positions']} positions)"
        )
    return lines


def _listed(values: Array) -> str:
    """Six numbers with their units."""
    return ", ".join(f"{a} {v:.3f}" for a, v in zip(AXES, values, strict=True)) + " (N, N m)"
