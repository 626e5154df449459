"""Fans that were measured, computed by the same method: thrust and power coefficients at rest, curve over curve.

Coefficients of propellers: C_T = T / (rho n^2 D^4), C_P = P / (rho n^3 D^5), n in turns a second, D at the blade's tip.
Merit is C_T^1.5 / C_P over the measured one: what the air gives for the power, however much the blade lifts.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from models.cfd import axisymmetric, config, table
from models.cfd.campaign import Row
from models.cfd.config import Setup
from models.errors import ModelError
from models.frames import Array

FANS = ("x22a", "apc_10x47")
"""Fan files that ship with measured points and computed cases."""
DATA = Path(__file__).parent.parent / "data"
POINTS = DATA / "measured_fans.csv"
MODEL_WORDS = {"wedge": "swirl", "wedge_no_swirl": "no swirl"}


@dataclass(frozen=True)
class Point:
    """One measured point at rest; ``source`` says where it is published. Errors are nan where none is stated."""

    fan: str
    variant: str
    rpm: float
    thrust: float
    thrust_error: float
    power: float
    power_error: float
    source: str


@dataclass(frozen=True)
class Computed:
    """Coefficients of one case. ``power`` nan without swirl; ``error`` that of ``thrust``'s mean."""

    model: str
    variant: str
    level: float
    h: float
    rpm: float
    thrust: float
    power: float
    error: float
    parts: tuple[float, ...]
    status: str


@dataclass(frozen=True)
class Compared:
    """One fan: what was measured and what was computed."""

    name: str
    title: str
    points: tuple[Point, ...]
    computed: tuple[Computed, ...]

    def free(self, model: str = "wedge", variant: str = "") -> list[Computed]:
        """Free cases of one model and variant on the usual mesh, by rotor speed."""
        found = [c for c in self.computed if (c.model, c.variant) == (model, variant) and math.isinf(c.h)]
        usual = self._usual()
        return sorted((c for c in found if c.level == usual), key=lambda c: c.rpm)

    def beside(self) -> list[tuple[Point, Computed]]:
        """Every measured point with each case of its variant and speed, with swirl and without."""
        return [
            (p, case)
            for p in self.points
            for model in MODEL_WORDS
            for case in self.free(model, p.variant)
            if case.rpm == p.rpm
        ]

    def ground(self, model: str = "wedge") -> list[tuple[float, float, float]]:
        """(h / R, thrust, thrust at equal power) over those of free air, at one speed, going up."""
        usual, free = self._usual(), {c.rpm: c for c in self.free(model)}
        low = [c for c in self.computed if (c.model, c.variant, c.level) == (model, "", usual) and math.isfinite(c.h)]
        out = []
        for c in sorted(low, key=lambda c: c.h):
            if c.rpm in free:
                thrust, power = c.thrust / free[c.rpm].thrust, c.power / free[c.rpm].power
                out.append((c.h, thrust, thrust / power ** (2 / 3)))
        return out

    def _usual(self) -> float:
        levels = [c.level for c in self.computed]
        return max(set(levels), key=levels.count)


def points() -> list[Point]:
    """All measured points that ship."""
    with POINTS.open(encoding="utf-8") as lines:
        return [_point(cell) for cell in csv.DictReader(lines)]


def _point(cell: dict[str, str]) -> Point:
    rpm, thrust, thrust_error, power, power_error = (
        float(cell[name]) for name in ("rpm", "C_T", "C_T_error", "C_P", "C_P_error")
    )
    return Point(cell["fan"], cell["variant"], rpm, thrust, thrust_error, power, power_error, cell["source"])


def shipped_cases(name: str) -> Path:
    """Case table of a fan that ships."""
    return DATA / f"{name}_cases.csv"


def compare(name: str, setup: Setup, rows: Sequence[Row]) -> Compared:
    """Coefficients of every wedge. Raises ModelError where none has a wrench."""
    computed = tuple(
        coefficients(setup, row) for row in rows if row.position.wedge and math.isfinite(row.result.wrench[2])
    )
    if not computed:
        raise ModelError(f"{name}: no wedge has been computed; run 'models cfd run --fan {name} --model wedge'")
    return Compared(name, setup.fan.name, tuple(p for p in points() if p.fan == name), computed)


def coefficients(setup: Setup, row: Row) -> Computed:
    """Thrust and power coefficient of one wedge."""
    position, result = row.position, row.result
    n = position.rpm / 60
    diameter = 2 * setup.fan.radius_m * setup.rotor.tip_radius
    force = setup.air.density_kg_m3 * n**2 * diameter**4
    power = 2 * math.pi * abs(result.wrench[5]) / (force * diameter) if position.swirl else math.nan
    return Computed(
        position.model,
        position.variant,
        position.level,
        position.h,
        position.rpm,
        result.wrench[2] / force,
        power,
        axisymmetric.mean_error(row) / force,
        tuple(p / force for p in result.parts),
        result.status,
    )


def shipped() -> list[Compared]:
    """The fans that ship, from their case tables."""
    return [compare(name, config.load(config.shipped(name)), table.read(shipped_cases(name))) for name in FANS]


def helicopters(height: Array) -> Array:
    """Thrust in ground effect over free thrust at equal power, (n,) over height / R (n,): fit to measured helicopters.

    Hayden 1976, "The effect of the ground on helicopter hovering power required", as given by Kan et al. 2019,
    IEEE RA-L 4(4), eq. 5.
    """
    out: Array = (0.9926 + 0.03794 * (2.0 / height) ** 2) ** (2 / 3)
    return out


def text(found: Sequence[Compared]) -> str:
    """Every measured point beside the cases of that variant and speed, other free cases, then the ground."""
    return "\n".join(line for c in found for line in (c.title, *_free_lines(c), *_ground_lines(c)))


def _free_lines(c: Compared) -> list[str]:
    beside = c.beside()
    lines = [_beside(p, case) for p, case in beside]
    shown = [case for _, case in beside]
    for case in c.computed:
        if math.isinf(case.h) and case.model == "wedge" and case not in shown:
            variant = f"{case.variant}, " if case.variant else ""
            lines.append(
                f"  {variant}mesh {case.level:g}, {case.rpm:g} rpm: C_T {case.thrust:.4f}, C_P {case.power:.4f}"
            )
    return lines


def _ground_lines(c: Compared) -> list[str]:
    lines = []
    for model, words in MODEL_WORDS.items():
        listed = [
            f"{thrust:.3f}" + ("" if math.isnan(equal) else f" ({equal:.3f} at equal power)") + f" at {h:g} R"
            for h, thrust, equal in c.ground(model)
        ]
        if listed:
            lines.append(f"  ground, {words}: thrust x " + ", ".join(listed))
    return lines


def _beside(p: Point, case: Computed) -> str:
    name = f"{p.variant}, " if p.variant else ""
    swirl = "" if case.model == "wedge" else ", no swirl"
    line = f"  {name}{p.rpm:g} rpm{swirl}: " + _against("C_T", case.thrust, p.thrust, p.thrust_error)
    if math.isnan(case.power):
        return line
    merit = (case.thrust / p.thrust) ** 1.5 / (case.power / p.power)
    return f"{line}; {_against('C_P', case.power, p.power, p.power_error)}; merit {merit - 1:+.1%}"


def _against(name: str, computed: float, known: float, error: float) -> str:
    stated = "" if math.isnan(error) else f" +- {error:g}"
    return f"{name} {computed:.4f}, measured {known:.4f}{stated}: {computed / known - 1:+.1%}"


def summary(found: Sequence[Compared]) -> dict[str, Any]:
    """The figures that a program reads."""
    return {
        c.name: {
            "free": [
                {
                    "variant": p.variant,
                    "rpm": p.rpm,
                    "swirl": case.model == "wedge",
                    "C_T": case.thrust,
                    "C_T_measured": p.thrust,
                    "C_P": None if math.isnan(case.power) else case.power,
                    "C_P_measured": p.power,
                }
                for p, case in c.beside()
            ],
            "ground": [{"h_over_r": h, "thrust": t, "at_equal_power": e} for h, t, e in c.ground()],
        }
        for c in found
    }


def figure(found: Sequence[Compared]) -> Any:
    """Coefficients over rotor speed or variant, measured and computed, and thrust over height."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(12, 4.2), layout="constrained")
    *panels, ground = drawn.subplots(1, len(found) + 1)
    for panel, c in zip(panels, found, strict=True):
        _coefficients(panel, c)
    _ground(ground, found)
    return drawn


def _coefficients(panel: Any, c: Compared) -> None:
    """Measured points and computed cases over rotor speed; of a fan that was measured at one speed, by variant."""
    variants = list(dict.fromkeys(p.variant for p in c.points)) or [""]
    speeds = {p.rpm for p in c.points}
    one_speed = len(speeds) == 1

    def place(variant: str, rpm: float) -> float:
        return variants.index(variant) if one_speed else rpm

    for k, (name, of) in enumerate((("C_T", "thrust"), ("C_P", "power"))):
        panel.plot([place(p.variant, p.rpm) for p in c.points], [getattr(p, of) for p in c.points],
                   "s", mfc="none", color=f"C{k}", label=f"{name}, measured")  # fmt: skip
        for model, mark in (("wedge", "o"), ("wedge_no_swirl", "x")):
            for variant in variants:
                cases = [x for x in c.free(model, variant) if not one_speed or x.rpm in speeds]
                if all(math.isnan(getattr(x, of)) for x in cases):
                    continue
                own = "" if one_speed else variant
                label = ", ".join(w for w in (name, "computed", MODEL_WORDS[model], own) if w)
                panel.plot([place(variant, x.rpm) for x in cases], [getattr(x, of) for x in cases],
                           mark if one_speed else f"{mark}-", color=f"C{k}", alpha=0.5 if own else 1.0,
                           label=None if one_speed and variant else label)  # fmt: skip
    if one_speed:
        names = [v.replace("_section_", "\nsection ").replace("_", " ") or "as published" for v in variants]
        panel.set_xticks(range(len(variants)), names, fontsize=8)
    panel.set(xlabel="" if one_speed else "rpm", ylabel="coefficient", title=c.title)
    # Room for the legend above the points.
    panel.set_ylim(0, 1.3 * panel.get_ylim()[1])
    panel.legend(fontsize=6, ncols=2, loc="upper left")


def _ground(panel: Any, found: Sequence[Compared]) -> None:
    for k, c in enumerate(found):
        for model, line in (("wedge", "o-"), ("wedge_no_swirl", "o:")):
            if column := c.ground(model):
                h, thrust, equal = zip(*column, strict=True)
                words = f"{c.name}, {MODEL_WORDS[model]}"
                panel.plot(h, thrust, line, color=f"C{k}", label=f"{words}, constant speed")
                if model == "wedge":
                    panel.plot(h, equal, "s--", color=f"C{k}", label=f"{words}, equal power")
    heights = np.linspace(0.5, 4, 80)
    panel.plot(heights, helicopters(heights), "k--", lw=1, label="measured helicopters (Hayden), equal power")
    panel.set(xlabel="h / R", ylabel="thrust over free thrust", title="Near the ground")
    panel.legend(fontsize=7)
