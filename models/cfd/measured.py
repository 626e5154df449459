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
    """Every measured point beside the case of the same variant and speed, then the ground."""
    lines = []
    for c in found:
        lines.append(c.title)
        for p in c.points:
            for case in (*c.free("wedge", p.variant), *c.free("wedge_no_swirl", p.variant)):
                if case.rpm == p.rpm:
                    lines.append(_beside(p, case))
        for case in c.computed:
            if math.isinf(case.h) and case.level != c._usual() and not case.variant:
                lines.append(f"  mesh {case.level:g}, {case.rpm:g} rpm: C_T {case.thrust:.4f}, C_P {case.power:.4f}")
        for case in c.computed:
            if case.variant and math.isinf(case.h) and not any(p.variant == case.variant for p in c.points):
                lines.append(f"  {case.variant}, {case.rpm:g} rpm: C_T {case.thrust:.4f}, C_P {case.power:.4f}")
        for model in ("wedge", "wedge_no_swirl"):
            ground = c.ground(model)
            if ground:
                swirl = "swirl" if model == "wedge" else "no swirl"
                listed = ", ".join(
                    f"{t:.3f}" + ("" if math.isnan(e) else f" ({e:.3f} at equal power)") + f" at {h:g} R"
                    for h, t, e in ground
                )
                lines.append(f"  ground, {swirl}: thrust x {listed}")
    return "\n".join(lines)


def _beside(p: Point, case: Computed) -> str:
    name = f"{p.variant}, " if p.variant else ""
    swirl = "" if case.model == "wedge" else ", no swirl"
    merit = (case.thrust / p.thrust) ** 1.5 / (case.power / p.power)
    power = f"; C_P {case.power:.4f}, measured {p.power:.4f}: {case.power / p.power - 1:+.1%}; merit {merit - 1:+.1%}"
    return (
        f"  {name}{p.rpm:g} rpm{swirl}: C_T {case.thrust:.4f}, measured {p.thrust:.4f}: "
        f"{case.thrust / p.thrust - 1:+.1%}" + ("" if math.isnan(case.power) else power)
    )


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
                for p in c.points
                for case in (*c.free("wedge", p.variant), *c.free("wedge_no_swirl", p.variant))
                if case.rpm == p.rpm
            ],
            "ground": [{"h_over_r": h, "thrust": t, "at_equal_power": e} for h, t, e in c.ground()],
        }
        for c in found
    }


def figure(found: Sequence[Compared]) -> Any:
    """Coefficients over rotor speed or variant, measured and computed, and thrust over height."""
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(12, 4.2), layout="constrained")
    panels = list(drawn.subplots(1, len(found) + 1))
    for panel, c in zip(panels, found, strict=False):
        _coefficients(panel, c)
    ground = panels[-1]
    for k, c in enumerate(found):
        for model, line in (("wedge", "o-"), ("wedge_no_swirl", "o:")):
            column = c.ground(model)
            if column:
                swirl = "swirl" if model == "wedge" else "no swirl"
                ground.plot([h for h, _, _ in column], [t for _, t, _ in column], line, color=f"C{k}",
                            label=f"{c.name}, {swirl}, constant speed")  # fmt: skip
        column = [row for row in c.ground() if c.name.startswith("apc")]
        if column:
            ground.plot([h for h, _, _ in column], [e for _, _, e in column], "s--", color=f"C{k}",
                        label=f"{c.name}, equal power")  # fmt: skip
    heights = np.linspace(0.5, 4, 80)
    ground.plot(heights, helicopters(heights), "k--", lw=1, label="measured helicopters (Hayden), equal power")
    ground.set(xlabel="h / R", ylabel="thrust over free thrust", title="Near the ground")
    ground.legend(fontsize=7)
    return drawn


def _coefficients(panel: Any, c: Compared) -> None:
    """Measured points and computed cases over rotor speed where there are several, else by variant."""
    many = len({p.rpm for p in c.points}) > 1
    variants = list(dict.fromkeys(p.variant for p in c.points))
    for k, (name, of) in enumerate((("C_T", "thrust"), ("C_P", "power"))):
        measured = [(p.rpm if many else variants.index(p.variant), getattr(p, of)) for p in c.points]
        panel.plot(*zip(*measured, strict=True), "s", mfc="none", color=f"C{k}", label=f"{name}, measured")
        for model, mark in (("wedge", "o"), ("wedge_no_swirl", "x")):
            for n, variant in enumerate(variants):
                cases = [x for x in c.free(model, variant) if many or x.rpm == c.points[0].rpm]
                drawn = [(x.rpm if many else n, getattr(x, of)) for x in cases if not math.isnan(getattr(x, of))]
                if drawn:
                    words = [name, "computed" if model == "wedge" else "no swirl", variant if many else ""]
                    label = ", ".join(w for w in words if w) if many or not variant else None
                    style = mark + ("-" if len(drawn) > 1 else "")
                    panel.plot(*zip(*drawn, strict=True), style, color=f"C{k}", alpha=0.5 if variant and many else 1,
                               label=label)  # fmt: skip
    if not many:
        names = [v.replace("_section_", "\nsection ").replace("_", " ") or "as published" for v in variants]
        panel.set_xticks(range(len(variants)), names, fontsize=8)
    panel.set(xlabel="rpm" if many else "", ylabel="coefficient", title=c.title, ylim=(0, None))
    panel.legend(fontsize=7)
