"""Rotor coefficient or throttle curve, and hover thrust, from the time of logs in which the vehicle hovers freely.

A hovering vehicle is carried by its rotors and nothing else, so the accelerometer weighs them: -Fz is their sum.
With rotor speeds one number follows, C_T; with servo outputs the thrust at full output, and the curve's bend where
the outputs vary enough.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.errors import LogError
from models.frames import Array
from models.vehicle import Throttle, Vehicle
from models.vehicle_setup.estimate import OPEN_ROTOR_CT
from replay.logs.formats import read_pieces
from replay.residual.record import Record, build_record

_CLIMB_M_S, _SPEED_M_S, _TILT_COS = 0.3, 1.0, 0.985
"""A hover: slower than these, tilted less than 10 degrees."""
_HIGH, _FAR = 4.0, 4.0
"""In rotor radii from ground, wall and ceiling: lift there is within 2 % of free air (Cheeseman and Bennett 1955)."""
_BLOCK_S = 5.0
"""Blocks this long are nearly independent: gusts and corrections of a hover last a second or two."""
ENOUGH_S = 8.0
"""As a diagnosis (residual.record.ENOUGH_S)."""
_EXPO_SD = 0.10
"""expo is taken from the log where its standard deviation is below this; else the file's stays."""


@dataclass(frozen=True)
class Estimate:
    """A number of the vehicle file: before, measured, and half its 95 % interval (None: the log gives none)."""

    key: str
    before: float | None
    value: float
    half: float | None
    note: str = ""

    def as_json(self) -> dict[str, Any]:
        """Plain numbers."""
        ci = None if self.half is None else [self.value - self.half, self.value + self.half]
        return {"before": self.before, "value": self.value, "ci95": ci, "note": self.note}

    def as_text(self) -> str:
        """One line."""
        before = "not given" if self.before is None else f"{self.before:.4g}"
        half = "" if self.half is None else f" ± {self.half:.2g}"
        return f"  {self.key:<14} {before:>9} -> {self.value:.4g}{half}{f' ({self.note})' if self.note else ''}"


@dataclass(frozen=True)
class Fit:
    """What the logs say."""

    vehicle: Vehicle
    """With the measured numbers."""
    estimates: tuple[Estimate, ...]
    hover_s: float
    notes: tuple[str, ...]
    output: float = math.nan
    """Mean output 0...1 of the rotors; NaN where rotor speeds are telemetered."""


@dataclass(frozen=True)
class _Hover:
    """Rows of hover (n,): lift [N], outputs 0...1 (n, rotors) or thrust of the file as it is [N], throttle, voltage."""

    block: NDArray[np.int64]
    lift: Array
    thrust: Array
    output: Array
    throttle: Array
    voltage: Array

    def __len__(self) -> int:
        return len(self.lift)


def fit(paths: Sequence[Path], vehicle: Vehicle, target_system: int | None = None) -> Fit:
    """Pool the hovers of several logs of one vehicle. Raises LogError where they hold too little of it."""
    start = _with_ct(vehicle)
    problems: list[LogError] = []
    records = (r for path in paths for r in records_of(path, start, target_system, problems))
    found = fit_records(records, vehicle, hovering, problems)
    if found.hover_s < ENOUGH_S:
        high = _HIGH * vehicle.rotor_radius_m
        raise LogError(
            f"{paths[0]}: only {found.hover_s:.0f} s of free hover (slower than {_CLIMB_M_S:g} m/s, above {high:.1f} "
            f"m, away from walls); {ENOUGH_S:.0f} s are needed, a minute is better"
        )
    return found


def fit_records(
    records: Iterable[Record], declared: Vehicle, where: Callable[[Record], NDArray[np.bool_]],
    problems: list[LogError] | None = None, *, bend: bool = True,
) -> Fit:  # fmt: skip
    """``fit`` on the rows ``where`` of records of the ``declared`` vehicle. Raises the first of ``problems``.

    ``bend``: whether ``expo`` is looked for.
    """
    start = _with_ct(declared)
    hovers: list[_Hover] = []
    notes: list[str] = []
    seconds = 0.0
    for record in records:
        rows = where(record)
        seconds += float(rows.sum()) * record.step_s
        hovers.append(_rows(record, rows, len(hovers)))
        notes += record.notes
    if not hovers and problems:
        raise problems[0]
    pooled = _pool(hovers)
    if not len(pooled):
        return Fit(start, (), 0.0, ())
    estimates = [_ct(start, declared, pooled)] if start.telemetered else _throttle(start, pooled, bend=bend)
    hover = _hover_thrust(declared, pooled)
    notes += [f"left out: {p}" for p in problems or ()]
    found = (*estimates, *([hover] if hover else []))
    if hover is None:
        notes.append("no believable thrust command in the logs: hover_thrust stays")
    output = float(np.median(pooled.output.mean(axis=1))) if pooled.output.size else math.nan
    return Fit(_applied(start, found), found, seconds, tuple(dict.fromkeys(notes)), output)


def records_of(path: Path, vehicle: Vehicle, target_system: int | None, problems: list[LogError]) -> Iterator[Record]:
    """Of every stretch of a log that can be judged; ``problems`` gets why others cannot."""
    try:
        for piece in read_pieces(path, target_system):
            try:
                yield build_record(piece.own(), vehicle, None)
            except LogError as error:
                problems.append(error)
    except LogError as error:
        problems.append(error)


def hovering(record: Record) -> NDArray[np.bool_]:
    """Rows (n,) of free hover: judged, slow, level, away from every surface that is seen."""
    state = record.context.state
    with np.errstate(invalid="ignore"):
        fast = (np.abs(state.velocity_ned[:, 2]) > _CLIMB_M_S) | (
            np.hypot(state.velocity_ned[:, 0], state.velocity_ned[:, 1]) > _SPEED_M_S
        )
    return free_flight(record) & ~fast & np.asarray(state.rotation[:, 2, 2] > _TILT_COS)


def free_flight(record: Record) -> NDArray[np.bool_]:
    """Rows (n,) that are judged, away from every surface that is seen."""
    state, radius = record.context.state, record.context.vehicle.rotor_radius_m
    near = (
        (np.nan_to_num(state.h_m, nan=np.inf).min(axis=1) < _HIGH * radius)
        | (np.nan_to_num(state.d_m, nan=np.inf).min(axis=1) < _FAR * radius)
        | (np.nan_to_num(state.ceiling_m, nan=np.inf).min(axis=1) < _HIGH * radius)
    )
    return np.asarray(record.valid & ~near)


def _with_ct(vehicle: Vehicle) -> Vehicle:
    if not vehicle.telemetered:
        return vehicle
    fans = tuple(f if f.ct is not None else replace(f, ct=OPEN_ROTOR_CT * len(f.rotors)) for f in vehicle.fans)
    return replace(vehicle, fans=fans)


def _rows(record: Record, rows: NDArray[np.bool_], number: int) -> _Hover:
    state, vehicle = record.context.state, record.context.vehicle
    block = (state.time_s[rows] // _BLOCK_S).astype(np.int64) + number * 1_000_000
    channels = [r.servo - 1 for r in vehicle.rotors if r.servo is not None]
    output = np.zeros((int(rows.sum()), 0))
    if vehicle.throttle is not None:
        low, high = vehicle.throttle.pwm_min_us, vehicle.throttle.pwm_max_us
        output = np.clip((state.servo_us[rows][:, channels] - low) / (high - low), 0.0, 1.0)
    return _Hover(
        block,
        -record.measured[rows, 2],
        record.context.thrust[rows].sum(axis=1),
        output,
        state.thrust_command[rows],
        state.battery_voltage_v[rows],
    )


def _pool(hovers: Sequence[_Hover]) -> _Hover:
    names = ("block", "lift", "thrust", "output", "throttle", "voltage")
    return _Hover(*(np.concatenate([getattr(h, name) for h in hovers]) for name in names))


def _ct(start: Vehicle, declared: Vehicle, h: _Hover) -> Estimate:
    ratio, half = _ratio(h.lift, h.thrust, h.block)
    now = start.fans[0].ct or OPEN_ROTOR_CT
    unequal = len({f.ct for f in start.fans}) > 1
    note = "of the first fan; the others scale with it" if unequal else "of a fan"
    return Estimate("ct", declared.fans[0].ct, now * ratio, None if half is None else now * half, note)


def _ratio(y: Array, x: Array, block: NDArray[np.int64]) -> tuple[float, float | None]:
    """Slope of y over x through zero, and its 95 % half width from the scatter of blocks of 5 s."""
    slope = float(y @ x / (x @ x))
    slopes = np.array([y[block == b] @ x[block == b] / (x[block == b] @ x[block == b]) for b in np.unique(block)])
    if len(slopes) < 2:
        return slope, None
    return slope, float(1.96 * slopes.std(ddof=1) / np.sqrt(len(slopes)))


def _throttle(vehicle: Vehicle, h: _Hover, *, bend: bool) -> list[Estimate]:
    """``max_thrust_n``, ``voltage_v``, and ``expo`` where the outputs vary enough to show it."""
    curve = vehicle.throttle
    assert curve is not None
    out = []
    expo, expo_half = curve.expo, None
    linear, square = h.output.sum(axis=1), (h.output**2).sum(axis=1)
    found = _bend(h, linear, square) if bend else None
    if found is not None:
        expo, expo_half = found
        out.append(Estimate("expo", curve.expo, expo, expo_half))
    shape = (1.0 - expo) * linear + expo * square
    top, half = _ratio(h.lift, shape, h.block)
    out.insert(0, Estimate("max_thrust_n", curve.max_thrust_n, top, half, "of one rotor at full output"))
    voltage = h.voltage[np.isfinite(h.voltage)]
    if voltage.size:
        out.append(Estimate("voltage_v", curve.voltage_v, float(np.median(voltage)), None, "of the battery in hover"))
    return out


def _bend(h: _Hover, linear: Array, square: Array) -> tuple[float, float] | None:
    """expo and its 95 % half width, from lift = a sum(u) + b sum(u^2); None where the log cannot show it."""

    def expo(rows: NDArray[np.bool_]) -> float:
        a, b = np.linalg.lstsq(np.column_stack([linear[rows], square[rows]]), h.lift[rows], rcond=None)[0]
        return float(b / (a + b)) if abs(a + b) > 1e-9 else float("nan")

    blocks = np.unique(h.block)
    if len(blocks) < 6:
        return None
    # Leave one block out (jackknife): neighbouring samples are not independent, blocks nearly are.
    left_out = np.array([expo(h.block != b) for b in blocks])
    n = len(blocks)
    sd = float(np.sqrt((n - 1) / n * ((left_out - left_out.mean()) ** 2).sum()))
    whole = expo(np.ones(len(h), bool))
    return (whole, 1.96 * sd) if sd < _EXPO_SD and -0.2 <= whole <= 1.0 else None


def _hover_thrust(vehicle: Vehicle, h: _Hover) -> Estimate | None:
    known = h.throttle[np.isfinite(h.throttle)]
    if known.size < 0.5 * len(h) or not 0.05 < float(np.median(known)) < 0.95:
        return None
    return Estimate("hover_thrust", vehicle.hover_thrust, float(np.median(known)), float(1.96 * known.std()), "scatter")


def _applied(vehicle: Vehicle, estimates: Sequence[Estimate]) -> Vehicle:
    values = {e.key: float(f"{e.value:.4g}") for e in estimates}
    out = vehicle
    if "ct" in values:
        scale = values["ct"] / (vehicle.fans[0].ct or OPEN_ROTOR_CT)
        fans = [replace(f, ct=float(f"{(f.ct or 0.0) * scale:.4g}")) for f in vehicle.fans]
        out = replace(out, fans=tuple(fans))
    if vehicle.throttle is not None:
        t = vehicle.throttle
        out = replace(
            out,
            throttle=Throttle(
                values.get("max_thrust_n", t.max_thrust_n), values.get("expo", t.expo), t.pwm_min_us, t.pwm_max_us,
                values.get("voltage_v", t.voltage_v),
            ),
        )  # fmt: skip
    return replace(out, hover_thrust=values.get("hover_thrust", vehicle.hover_thrust))
