"""Rotor speeds and outputs that are not to be believed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from models.common.frames import Array
from models.effects import Context
from models.vehicle import Vehicle
from models.vehicle.rotor_speed import Hover, misread
from replay.flightlog import FlightLog, LogFault
from replay.residual.distances import MAX_GAP_S
from replay.residual.grid import Mask, band
from replay.residual.motion import Trajectory, rotor_rate_hz

FEWEST_SAMPLES = 50
"""Airborne samples from which on rotors are compared."""
DEAD_SHARE = 0.05
STUCK_SHARE = 1e-3
STUCK_BESIDE = 0.1
"""A rotor is dead below this share of the others' speed, stuck if it varies by less than this share, and by less than
this share of what the others do."""
OTHER_SPEED = (0.6, 1.7)
"""Speed over the others' median outside which no trim explains it: thrust goes with its square, 0.4 and 2.9."""
SOUND_M_S = 340.0
"""A tip faster than sound is no propeller's (ISA sea level)."""
NOT_ITS_SPEED = "not the speed of this rotor (poles, gear, unit)"
TURNING_SHARE = 0.3
"""Speed over the declared rotors' from which on an undeclared one takes part."""
ROTOR_RATE_HZ = 5.0
"""Rotor speeds or outputs slower than this carry no moments: attitude loops answer within a fifth of a second."""
FULL = 0.985
FULL_REPORTED = 0.2
FULL_MOST = 0.5
"""Command from which on thrust does not follow; share of the flight at it that is reported and left out; share from
which on no lift can be judged."""
MOVES_US = 30.0
"""An output that never moves by more drives no motor in flight."""
FEWEST_ORDERED = 3
"""Rotors that have an order."""
APART_S = (0.1, 2.0)
FOLLOWS_S = 0.3
"""Half widths between which speeds and outputs are compared, and time within which a motor and its telemetry follow."""
FOLLOWS = 0.6
FOLLOWS_LESS = 0.5
"""Correlation of every speed with another motor's output; that with its own is below this share of it."""
EQUAL_US = 1.0
EQUAL_RPM = 1.0
TURNS_RAD_S = 0.05
"""Outputs that never differ by more, or speeds while the vehicle rolls or pitches by more (RMS), are copies."""


def wrong_speeds(ctx: Context, flying: Mask) -> list[LogFault]:
    """Rotor speeds that read nothing, stand still while the others move, or are another multiple than the others'."""
    vehicle = ctx.vehicle
    if not vehicle.telemetered or flying.sum() < FEWEST_SAMPLES:
        return []
    typical = np.nanmedian(ctx.state.rpm[flying], axis=0)
    spread = np.nanstd(ctx.state.rpm[flying], axis=0)
    out = []
    for k in range(len(typical)):
        what = _wrong_speed(ctx, flying, typical, spread, k)
        if what is not None:
            out.append(LogFault(_channel(vehicle, k), what))
    return out


def _wrong_speed(ctx: Context, flying: Mask, typical: Array, spread: Array, k: int) -> str | None:
    """What is wrong with a rotor, by the ``typical`` speeds (rotors,) in flight and their ``spread``."""
    rpm = typical[k]
    others = np.isfinite(typical) & (np.arange(len(typical)) != k)
    usual = np.nan
    usual_spread = np.nan
    if others.any():
        usual = float(np.median(typical[others]))
        usual_spread = float(np.median(spread[others]))
    tip_m_s = ctx.vehicle.rotor_radius_m * rpm * 2.0 * np.pi / 60.0
    least, most = OTHER_SPEED
    if rpm < DEAD_SHARE * usual:
        return f"reads {rpm:.0f} rpm in flight{_output_of(ctx, k, flying)}"
    if spread[k] < STUCK_SHARE * usual and spread[k] < STUCK_BESIDE * usual_spread:
        return f"stays at {rpm:.0f} rpm while the others vary"
    if tip_m_s > SOUND_M_S:
        return f"is {rpm:.0f} rpm, {tip_m_s:.0f} m/s at the tip: {NOT_ITS_SPEED}"
    if len(typical) > 2 and (rpm < least * usual or rpm > most * usual):
        return f"is {rpm / usual:.2g} times the other rotors': {NOT_ITS_SPEED}"
    return None


def impossible_speeds(
    log: FlightLog, ctx: Context, motion: Trajectory, flying: Mask
) -> list[LogFault]:
    """Speeds that no multirotor hovers with on such a battery: all in another unit, or by another number of poles.

    Of all ESCs of the log, whether or not the vehicle file takes its thrust from them.
    """
    if flying.sum() < FEWEST_SAMPLES:
        return []
    rpm = _median_rpm(log, motion.grid.t[flying])
    if rpm is None:
        return []
    what = misread(rpm, _hover(log, ctx.vehicle), log.parameters)
    if what is None:
        return []
    return [LogFault(f"rpm_{min(log.escs)}", what)]


def too_slow_to_fly(log: FlightLog, ctx: Context, motion: Trajectory) -> str | None:
    """What is wrong with speeds that carry nothing by the vehicle file, of a log in which they never do; or None."""
    vehicle = ctx.vehicle
    rpm = _median_rpm(log, motion.grid.t)
    if rpm is None or not vehicle.telemetered or vehicle.assumed:
        return None
    hover = replace(_hover(log, vehicle), mass_kg=vehicle.mass_kg, radius_m=vehicle.rotor_radius_m)
    return misread(rpm, hover, log.parameters)


def _median_rpm(log: FlightLog, t: Array) -> float | None:
    """Median speed [rpm] of the ESCs that turn at the times ``t`` (n,)."""
    series = [esc.rpm for esc in log.escs.values() if esc.rpm is not None]
    speeds = [rpm.at(t, MAX_GAP_S)[:, 0] for rpm in series]
    turning = [float(np.median(rpm[rpm > 0.0])) for rpm in speeds if (rpm > 0.0).any()]
    if turning:
        return float(np.median(turning))
    return None


def _hover(log: FlightLog, vehicle: Vehicle) -> Hover:
    """What is known without doubt: rotors and battery."""
    if log.battery is None:
        voltage = np.empty(0)
    else:
        voltage = log.battery.values[:, 0]
    known = voltage[np.isfinite(voltage)]
    if known.size:
        volts = float(np.median(known))
    else:
        volts = np.nan
    return Hover(rotors=len(vehicle.rotors), places=len(vehicle.fans), voltage_v=volts)


def shifted_speeds(
    log: FlightLog, ctx: Context, motion: Trajectory, flying: Mask
) -> list[LogFault]:
    """Speeds that stand at other ESC numbers than their motors: each follows the output of another one.

    Right is ArduPilot's rule (an ESC has the number of its output), PX4's (that of its motor), and the mere order.
    """
    vehicle = ctx.vehicle
    numbers = [rotor.esc for rotor in vehicle.rotors if rotor.esc is not None]
    if flying.sum() < FEWEST_SAMPLES:
        return []
    declared = log.motor_outputs.numbers
    ours = set(declared.values())
    moving = [o for o in _moving_outputs(ctx, flying) if not ours or o in ours]
    if not vehicle.telemetered or len(numbers) < FEWEST_ORDERED or len(numbers) != len(moving):
        return []
    correlations = _followed(ctx, motion, flying, moving)

    def fit(order: list[int]) -> float:
        return float(correlations[range(len(order)), order].mean())

    right = _right_orders(numbers, moving, declared)
    wrong: list[list[int]] = []
    for order in right:
        wrong += _disorders(order)
    best = max(wrong, key=lambda order: round(fit(order), 1))
    fit_of_right = max(fit(order) for order in right)
    if fit(best) < FOLLOWS or fit_of_right > FOLLOWS_LESS * fit(best):
        return []
    pairs = sorted(zip(numbers, [moving[k] for k in best], strict=True))
    orders = ", ".join(f"ESC {n} output {o}" for n, o in pairs)
    what = (
        f"speeds stand at the numbers of other motors: {orders} would fit; moments cannot be judged"
    )
    return [LogFault(f"rpm_{min(numbers)}", what)]


def _right_orders(
    numbers: list[int], moving: list[int], declared: Mapping[int, int]
) -> list[list[int]]:
    """Which of the ``moving`` outputs (from 0) belongs to each ESC number, by every rule that fits them."""
    by_rank = dict(zip(sorted(numbers), moving, strict=True))
    by_motor = {motor: declared.get(motor, motor) for motor in range(1, len(numbers) + 1)}
    rules = (
        numbers,
        [by_rank[n] for n in numbers],
        [by_motor.get(n, 0) for n in numbers],
    )
    out = []
    for outputs in rules:
        if set(outputs) == set(moving):
            out.append([moving.index(o) for o in outputs])
    return out


def _disorders(way: list[int]) -> list[list[int]]:
    """Orders that a mistake makes of ``way``: shifted by one, by more, and two exchanged."""
    steps = sorted(range(1, len(way)), key=lambda step: min(step, len(way) - step))
    out = [way[-step:] + way[:-step] for step in steps]
    for i, j in combinations(range(len(way)), 2):
        other = list(way)
        other[i] = way[j]
        other[j] = way[i]
        out.append(other)
    return out


def _moving_outputs(ctx: Context, flying: Mask) -> list[int]:
    """Outputs, from 1, that move in flight."""
    servo = ctx.state.servo_us[flying]
    known = np.isfinite(servo).all(axis=0)
    if not len(servo):
        return []
    return [int(k) + 1 for k in np.flatnonzero(known) if np.ptp(servo[:, k]) > MOVES_US]


def _followed(ctx: Context, motion: Trajectory, flying: Mask, moving: Sequence[int]) -> Array:
    """Correlation (rotors, outputs) of every speed with every output, without what is common to all of them."""
    rate = motion.grid.rate
    speeds = _apart(ctx.state.rpm, rate)
    commands = _apart(ctx.state.servo_us[:, [o - 1 for o in moving]], rate)
    latest = round(FOLLOWS_S * rate)
    out = np.zeros((speeds.shape[1], commands.shape[1]))
    for late in range(0, latest + 1, max(latest // 10, 1)):
        use = flying[late:]
        a = speeds[late:][use]
        b = commands[: len(commands) - late][use]
        known = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
        if known.sum() < FEWEST_SAMPLES:
            continue
        with np.errstate(invalid="ignore"):
            both = np.corrcoef(a[known].T, b[known].T)
        found = np.nan_to_num(both[: len(out), len(out) :])
        out = np.maximum(out, found)
    return out


def _apart(x: Array, rate: float) -> Array:
    """What of (n, k) changes within ``APART_S``, less the mean of all."""
    fast = np.stack([band(column, rate, *APART_S) for column in x.T], axis=1)
    return np.asarray(fast - fast.mean(axis=1, keepdims=True))


def undeclared_rotors(log: FlightLog, ctx: Context) -> list[LogFault]:
    """Rotors that turn and that the vehicle file does not know."""
    if not ctx.vehicle.telemetered:
        return []
    if np.isfinite(ctx.state.rpm).any():
        usual = float(np.nanmedian(ctx.state.rpm))
    else:
        usual = np.inf
    known = {rotor.esc for rotor in ctx.vehicle.rotors}
    what = "turns in flight, and the vehicle file knows no such rotor"
    out = []
    for number, esc in log.escs.items():
        if number in known or esc.rpm is None:
            continue
        if float(np.nanmedian(esc.rpm.values)) > TURNING_SHARE * usual:
            out.append(LogFault(f"rpm_{number}", what))
    return out


def full_command(ctx: Context, flying: Mask) -> tuple[list[LogFault], Mask]:
    """Outputs at full command in a good part of the flight, and when any rotor is at it (n,)."""
    never = np.zeros(len(flying), bool)
    curve = ctx.vehicle.throttle
    if curve is None or not flying.any():
        return [], never
    columns = [(rotor.servo or 1) - 1 for rotor in ctx.vehicle.rotors]
    outputs = ctx.state.servo_us[:, columns]
    range_us = curve.pwm_max_us - curve.pwm_min_us
    with np.errstate(invalid="ignore"):
        at_stop = (outputs - curve.pwm_min_us) / range_us >= FULL
    at_stop &= flying[:, None]
    full = np.asarray(at_stop.any(axis=1))
    share = float(full.sum() / flying.sum())
    if share <= FULL_REPORTED:
        return [], never
    most = int(at_stop.sum(axis=0).argmax())
    what = f"at full command in {share:.0%} of the flight: thrust does not follow"
    return [LogFault(_channel(ctx.vehicle, most), what)], full


def slow_rotors(log: FlightLog, vehicle: Vehicle) -> list[LogFault]:
    """Rotor speeds or outputs that come too slowly for moments."""
    rate = rotor_rate_hz(log, vehicle)
    if rate >= ROTOR_RATE_HZ:
        return []
    return [LogFault(_channel(vehicle, 0), f"comes at {rate:.1f} Hz: too slow for moments")]


def copies(log: FlightLog, ctx: Context, motion: Trajectory, flying: Mask) -> list[LogFault]:
    """All outputs, or all speeds of a vehicle that turns, are one number: no moment can be modelled."""
    vehicle = ctx.vehicle
    if vehicle.telemetered:
        values = ctx.state.rpm[flying]
        most = EQUAL_RPM
        what = (
            "all rotor speeds are copies of one number while the vehicle turns: moments cannot be "
            "judged"
        )
    else:
        assert log.servo is not None
        columns = [r.servo - 1 for r in vehicle.rotors if r.servo is not None]
        values = log.servo.values[:, columns]
        most = EQUAL_US
        what = "all servo outputs are copies of one number: moments cannot be judged"
    values = values[np.isfinite(values).all(axis=1)]
    samples, count = values.shape
    if count < 2 or samples < FEWEST_SAMPLES or np.ptp(values, axis=1).max() > most:
        return []
    if vehicle.telemetered:
        turning = np.nanstd(motion.gyro[flying, :2], axis=0)
        if not turning.max() > TURNS_RAD_S:
            return []
    return [LogFault(_channel(vehicle, 0), what)]


def _output_of(ctx: Context, k: int, flying: Mask) -> str:
    """What the output of the same number says, in words; empty where there is none."""
    esc = ctx.vehicle.rotors[k].esc
    if esc is None or esc > ctx.state.servo_us.shape[1]:
        return ""
    known = ctx.state.servo_us[flying, esc - 1]
    known = known[np.isfinite(known)]
    if known.size:
        return f" while output {esc} is at {float(np.median(known)):.0f} us"
    return ""


def _channel(vehicle: Vehicle, k: int) -> str:
    """Of rotor ``k`` of the vehicle file: its speed, or its output."""
    rotor = vehicle.rotors[k]
    if rotor.servo is None:
        return f"rpm_{rotor.esc}"
    return f"servo_{rotor.servo}"
