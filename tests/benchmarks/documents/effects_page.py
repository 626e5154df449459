"""Write docs/effects.md and docs/effects.png: every effect of the catalogue, with what it does on one made-up flight.

    python tests/benchmarks documents.effects_page            # write both
    python tests/benchmarks documents.effects_page --check    # exit code 1 where the page is not up to date

The flight is no recording: two minutes in which heights, distances, speeds, thrust and voltage swing, each at another
period. An effect is drawn at its typical size, in the middle shape of its grid, on the axis where it does most.
"""

from __future__ import annotations

import inspect
import math
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import command_line
import numpy as np

import models
from companion.vehicles import default_vehicle
from models.air_state import blank_state
from models.common.frames import AXES, Array, quaternion_from_euler, rotation_from_quaternion
from models.effects import Context, Effect, catalogue
from models.effects.flight_use import InFlight
from models.effects.pictures import over_time

DOCS = Path(__file__).resolve().parents[3] / "docs"
PAGE = DOCS / "effects.md"
PICTURE = DOCS / "effects.png"
SECONDS = 120.0
STEP_S = 0.2
COLUMNS = 4
_HEAD = """# Effects

This is the catalogue of what `replay diagnose` can name. `python tests/benchmarks documents.effects_page` writes this
page from the files in `models/effects/`, one file for each effect. How to read an answer: [diagnosis](diagnose.md). How
the search chooses between effects: [search](search.md).

![Force or moment of each effect over the quantity that shows it](effects.png)

The picture is computed, not measured: one made-up flight of the built-in vehicle, each effect at its typical size, with
positive coefficients. It shows form and axis, not what is likely.

| belongs to | an amended model |
|---|---|
| vehicle, place | keeps it for the next flight |
| weather, load | starts the next flight without it |
| instrument | corrects the logs of that instrument; it is never flown |
"""


def flight() -> Context:
    """The made-up flight; body frame FRD, world NED."""
    vehicle = default_vehicle()
    t = np.arange(0.0, SECONDS, STEP_S)

    def swing(low: float, high: float, period_s: float) -> Array:
        return np.asarray(low + (high - low) * 0.5 * (1.0 - np.cos(2.0 * math.pi * t / period_s)))

    def each(values: Array, count: int) -> Array:
        return np.repeat(values[:, None], count, axis=1)

    fans = len(vehicle.fans)
    rotors = len(vehicle.rotors)
    radius = vehicle.rotor_radius_m
    yaw = swing(0.0, 2.0, 90.0)
    velocity = np.stack(
        [swing(-3.0, 3.0, 23.0), swing(-3.0, 3.0, 31.0), swing(-1.5, 1.5, 17.0)], axis=1
    )
    # What turns about the vertical: rotors of one spin against those of the other.
    spins = [rotor.spin for rotor in vehicle.rotors]
    turning = np.outer(swing(-20.0, 20.0, 5.0), spins)
    state = blank_state((len(t),), fans, rotors)
    filled = {
        "time_s": t,
        "velocity_ned": velocity,
        "position_ned": np.cumsum(velocity, axis=0) * STEP_S,
        "rotation": np.array(
            [rotation_from_quaternion(quaternion_from_euler(0.0, 0.0, float(y))) for y in yaw]
        ),
        "rates": np.stack(
            [swing(-0.5, 0.5, 7.0), swing(-0.5, 0.5, 9.0), np.gradient(yaw, STEP_S)], axis=1
        ),
        "specific_force": np.tile([0.0, 0.0, -9.81], (len(t), 1)),
        "h_m": each(swing(0.6 * radius, 6.0 * radius, 41.0), fans),
        "d_m": each(swing(0.3 * radius, 6.0 * radius, 29.0), fans),
        "second_d_m": each(swing(0.3 * radius, 6.0 * radius, 37.0), fans),
        "second_bearing_rad": np.full(len(t), math.pi / 2.0),
        "ceiling_m": each(swing(0.3 * radius, 6.0 * radius, 43.0), fans),
        "rpm": each(swing(3700.0, 4300.0, 11.0), rotors) + turning,
        "battery_voltage_v": 16.8 - 2.0 * t / SECONDS,
        "battery_current_a": swing(18.0, 26.0, 11.0),
        "esc_temperature_c": 30.0 + 40.0 * t / SECONDS,
        "pressure_pa": np.full(len(t), 95000.0),
        "air_temperature_c": np.full(len(t), 30.0),
    }
    return Context(state=replace(state, **filled), vehicle=vehicle, model=models.load())


def curve(effect: Effect, ctx: Context) -> tuple[str, str, Array, Array]:
    """Labels of both axes, the quantity and the force or moment, on the axis where it is largest."""
    shapes = list(effect.shape_grid(ctx)) or [()]
    shape = shapes[len(shapes) // 2]
    size = np.array(
        [c.mean(ctx) + c.spread(ctx) * (c.name in effect.main_names) for c in effect.coefficients]
    )
    if effect.search.remainder:
        size = np.where([c.name.endswith("_of_model") for c in effect.coefficients], -0.3, 0.0)
    wrench = np.nan_to_num(effect.regressors(ctx, shape)) @ size
    unit = np.where(np.arange(6) < 3, ctx.weight, ctx.weight * ctx.lever)
    strength = np.sqrt((wrench**2).mean(axis=0)) / unit
    axis = AXES[int(np.argmax(strength))]
    drawn = (effect.shown.drawn or over_time)(ctx, axis)
    force = (wrench * np.broadcast_to(drawn.direction, wrench.shape)).sum(axis=1)
    known = np.isfinite(drawn.values)
    return drawn.label, drawn.force_label, drawn.values[known], force[known]


def draw(effects: list[Effect], ctx: Context) -> None:
    """One panel for each effect."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams.update({"font.size": 7})
    import matplotlib.pyplot as plt

    rows = math.ceil(len(effects) / COLUMNS)
    figure, axes = plt.subplots(
        rows, COLUMNS, figsize=(3.0 * COLUMNS, 2.1 * rows), layout="constrained"
    )
    for panel, effect in zip(axes.flat, effects, strict=False):
        label, force_label, x, y = curve(effect, ctx)
        panel.set_title(effect.name, fontsize=8, fontweight="bold")
        panel.plot(x, y, ".", markersize=1.5, color="tab:blue")
        panel.axhline(0.0, color="0.7", linewidth=0.6)
        panel.set_xlabel(label)
        panel.set_ylabel(force_label, fontsize=6)
    for panel in axes.flat[len(effects) :]:
        panel.set_visible(False)
    figure.savefig(PICTURE, metadata={"Software": None}, dpi=90)


def page(effects: list[Effect]) -> str:
    """The page."""
    return "\n".join([_HEAD, *(section(effect) for effect in effects)])


def section(effect: Effect) -> str:
    """What the catalogue says of one effect; its file's docstring says where it is valid, and its source."""
    about = inspect.getdoc(import_module(f"models.effects.{effect.name}")) or ""
    valid, source = " ".join(about.split("\n\nValid: ")[1].split()).split(" Source: ")
    flown = (
        ""
        if effect.in_flight.use is InFlight.WRENCH
        else f" In flight: {effect.in_flight.use.value}."
    )
    lines = [
        f"## {effect.name}\n",
        f"- Equation: `{effect.equation}`",
        f"- Sign: {effect.sign}. Valid: {valid}",
        f"- Belongs to: {effect.belongs_to.value}.{flown}",
        f"- Axes: {', '.join(effect.axes)}. Needs: {', '.join(f'`{c}`' for c in effect.channels) or 'nothing more'}.",
        f"- To show it: {effect.excite}.",
    ]
    if effect.shown.quantities:
        said = ", ".join(f"`{q.name}` for `{q.instead_of}`" for q in effect.shown.quantities)
        lines.append(f"- Said in an answer: {said}.")
    if effect.aliases:
        lines.append(
            f"- Easily confused with: {', '.join(f'[{a}](#{a})' for a in effect.aliases)}."
        )
    return "\n".join([*lines, f"- Source: {source}", ""])


def main() -> int:
    """Write, or compare."""
    p = command_line.parser(__doc__)
    p.add_argument(
        "--check", action="store_true", help="exit code 1 where the page is not up to date"
    )
    a = p.parse_args()
    effects = list(catalogue())
    text = page(effects)
    if a.check:
        return 0 if PAGE.exists() and PAGE.read_text(encoding="utf-8") == text else 1
    PAGE.write_text(text, encoding="utf-8")
    draw(effects, flight())
    return 0


if __name__ == "__main__":
    sys.exit(main())
