"""Faults of a log, or of the vehicle file it is read with: reported, left out, and never named as an effect."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.air_state import AirState
from models.effects import Context
from models.frames import Array
from models.vehicle import Vehicle
from replay.flightlog import Beam, FlightLog
from replay.residual.grid import Grid, Mask, rate_of_change, running_mean
from replay.residual.log_state import rotor_rate_hz
from replay.residual.motion import Motion

DERIVED_OVER_S, DERIVED_M_S2, DERIVED_SHARE = (0.5, 5.0), 0.003, 0.2
"""Times over which accelerometer and derivative of the velocity are compared; spread of their difference over the
longer, and its share of that over the shorter (a tenth for derivatives), below which no accelerometer has measured."""
DEAD_SHARE, STUCK_SHARE = 0.05, 1e-3
"""A rotor is dead below this share of the others' speed, stuck if it varies by less than this share."""
ROTOR_RATE_HZ = 5.0
"""Rotor speeds or outputs slower than this carry no moments."""
FULL, FULL_REPORTED, FULL_MOST = 0.985, 0.2, 0.5
"""Command from which on thrust does not follow; share of the flight at it that is reported, that leaves no lift."""
OPPOSED = -0.5
"""Correlation of declared moment and angular acceleration from which on a vehicle file is mirrored."""
DISAGREE = 0.7
"""RMS difference of gyro and turning attitude, as a share of the gyro's, from which on one of them is wrong."""
LIFT_RANGE = (0.5, 1.8)
"""Declared lift over weight, on average in flight, outside which the file is another vehicle's."""
STUCK_BEAM_M, MOVED_M = 0.002, 0.4
UPSIDE_DOWN = 0.3
"""Cosine of the tilt below which nothing flies."""


@dataclass(frozen=True)
class LogFault:
    """A channel that is not to be believed, and why."""

    channel: str
    what: str


DERIVED_ACCELEROMETER = LogFault("ax_m_s2", "is derived from the velocity: it measures nothing of its own")


@dataclass(frozen=True)
class Doubts:
    """What was found wrong, the axes that can still be judged, and samples that are left out (n,)."""

    faults: tuple[LogFault, ...]
    axes: tuple[int, ...]
    left_out: Mask
    blind: tuple[int, ...] = ()
    """Axes that are not judged, but on which something acts all the same."""


def derived_accelerometer(motion: Motion, flying: Mask) -> bool:
    """Whether the specific force is a derivative of the logged velocity.

    Two derivatives of one velocity differ by how they smooth it, so that their difference averages out as one over the
    time; the offset of an accelerometer and the tilt error of an estimator do not average out.
    """
    rate = motion.grid.rate
    difference = np.einsum("nij,nj->ni", motion.rotation, motion.kinematic_bias)
    difference[~flying] = np.nan
    spread = []
    for seconds in DERIVED_OVER_S:
        half = int(seconds / 2.0 * rate)
        mean = np.stack([running_mean(difference[:, a], half) for a in range(3)], axis=1)
        mean = mean[np.convolve(flying, np.ones(2 * half + 1), "same") > 2 * half]
        if len(mean) < DERIVED_OVER_S[1] * rate:
            return False
        spread.append(np.nanstd(mean, axis=0))
    short, long = spread
    return bool((long < DERIVED_M_S2).all() and (long < DERIVED_SHARE * short).all())


def doubted(log: FlightLog, ctx: Context, grid: Grid, flying: Mask, axes: list[int]) -> Doubts:
    """Doubt the log before anything is fitted. ``flying`` (n,): airborne samples of the grid."""
    faults: list[LogFault] = []
    left_out = np.zeros(len(grid.t), bool)
    usable, blind = set(axes), set[int]()
    rotors = _rotors(log, ctx, flying)
    if rotors:
        faults += rotors
        blind |= usable & {2}
        usable -= {2, 3, 4, 5}
    full, share = _at_full_command(ctx, flying)
    if share > FULL_REPORTED:
        faults.append(_full_fault(ctx, full & flying[:, None], share))
    if share > FULL_MOST:
        blind |= usable & {2}
        usable -= {2, 3, 4, 5}
    lift = _wrong_lift(ctx, flying)
    if lift is not None and not rotors and 2 in usable:
        faults.insert(0, lift)
        usable -= {2, 3, 4, 5}
    if usable & {3, 4, 5}:
        moments = [*_slow_rotors(log, ctx.vehicle), *_gyro(ctx.state, grid, flying), *_mirrored(ctx, grid, flying)]
        if moments:
            faults += moments
            usable -= {3, 4, 5}
    crash = _crash(ctx.state, grid)
    if crash is not None:
        faults.append(LogFault("roll_rad", f"upside down from {grid.t[crash]:.0f} s on: what follows is no flight"))
        left_out[max(crash - int(grid.rate), 0) :] = True
    return Doubts(tuple(faults), tuple(sorted(usable)), left_out, tuple(sorted(blind)))


def without_stuck_beams(log: FlightLog) -> tuple[FlightLog, list[LogFault]]:
    """The log without rangefinders that never move while the vehicle does."""
    if log.position is None:
        return log, []
    moved = float(np.ptp(log.position.values[:, 2]))
    stuck = [b for b in log.beams if moved > MOVED_M and _stuck(b)]
    faults = [
        LogFault(f"range_{b.name}_m", f"stays at {float(np.median(b.good.values)):.2f} m while the vehicle moves")
        for b in stuck
    ]
    return replace(log, beams=tuple(b for b in log.beams if b not in stuck)), faults


def _stuck(beam: Beam) -> bool:
    good = beam.good
    return beam.name in ("down", "up") and len(good) > 20 and float(np.ptp(good.values)) < STUCK_BEAM_M


def _name(vehicle: Vehicle, k: int) -> str:
    """Channel of a rotor: its speed, or its output."""
    rotor = vehicle.rotors[k]
    return f"rpm_{rotor.esc}" if rotor.servo is None else f"servo_{rotor.servo}"


def _rotors(log: FlightLog, ctx: Context, flying: Mask) -> list[LogFault]:
    """Rotor speeds that read nothing, or stand still while the others move; rotors that the file does not know."""
    vehicle = ctx.vehicle
    if not vehicle.telemetered or flying.sum() < 50:
        return []
    speed = ctx.state.rpm[flying]
    typical = np.nanmedian(speed, axis=0)
    out = []
    for k in range(len(vehicle.rotors)):
        others = np.delete(np.arange(len(vehicle.rotors)), k)
        if not others.size or not np.isfinite(typical[others]).any():
            continue
        usual = float(np.nanmedian(typical[others]))
        varies = float(np.nanmedian(np.nanstd(speed[:, others], axis=0)))
        if typical[k] < DEAD_SHARE * usual:
            output = _output_of(log, ctx, k, flying)
            out.append(LogFault(_name(vehicle, k), f"reads {typical[k]:.0f} rpm in flight{output}"))
        elif np.nanstd(speed[:, k]) < STUCK_SHARE * usual < 0.1 * varies:
            out.append(LogFault(_name(vehicle, k), f"stays at {typical[k]:.0f} rpm while the others vary"))
    known = {rotor.esc for rotor in vehicle.rotors}
    for number, esc in log.escs.items():
        if number in known or esc.rpm is None or not typical.size:
            continue
        if float(np.nanmedian(esc.rpm.values)) > 0.3 * float(np.nanmedian(typical)):
            out.append(LogFault(f"rpm_{number}", "turns in flight, and the vehicle file knows no such rotor"))
    return out


def _output_of(log: FlightLog, ctx: Context, k: int, flying: Mask) -> str:
    """What the output of the same number says, in words; empty where there is none."""
    esc = ctx.vehicle.rotors[k].esc
    if log.servo is None or esc is None or esc > ctx.state.servo_us.shape[1]:
        return ""
    known = ctx.state.servo_us[flying, esc - 1]
    known = known[np.isfinite(known)]
    return f" while output {esc} is at {float(np.median(known)):.0f} us" if known.size else ""


def _at_full_command(ctx: Context, flying: Mask) -> tuple[Mask, float]:
    """Samples (n, rotors) at full command, and the share of the flight in which any rotor is."""
    curve = ctx.vehicle.throttle
    n = len(flying)
    if curve is None:
        return np.zeros((n, 1), bool), 0.0
    outputs = np.stack([ctx.state.servo_us[:, (r.servo or 1) - 1] for r in ctx.vehicle.rotors], axis=1)
    with np.errstate(invalid="ignore"):
        full = (outputs - curve.pwm_min_us) / (curve.pwm_max_us - curve.pwm_min_us) >= FULL
    return full, float(full[flying].any(axis=1).mean()) if flying.any() else 0.0


def _full_fault(ctx: Context, full: Mask, share: float) -> LogFault:
    worst = int(full.sum(axis=0).argmax())
    return LogFault(_name(ctx.vehicle, worst), f"at full command in {share:.0%} of the flight: thrust does not follow")


def _wrong_lift(ctx: Context, flying: Mask) -> LogFault | None:
    if flying.sum() < 50:
        return None
    measured = -ctx.vehicle.mass_kg * float(np.nanmean(ctx.state.specific_force[flying, 2]))
    ratio = float(np.nanmean(ctx.thrust.sum(axis=1)[flying])) / max(measured, 1e-6)
    if not np.isfinite(ratio) or LIFT_RANGE[0] <= ratio <= LIFT_RANGE[1]:
        return None
    return LogFault(
        "vehicle file", f"declares {ratio:.2g} of the lift that flew: mass, rotors or thrust of another vehicle"
    )


def _slow_rotors(log: FlightLog, vehicle: Vehicle) -> list[LogFault]:
    rate = rotor_rate_hz(log, vehicle)
    if rate >= ROTOR_RATE_HZ:
        return []
    return [LogFault(_name(vehicle, 0), f"comes at {rate:.1f} Hz: too slow for moments")]


def _gyro(state: AirState, grid: Grid, flying: Mask) -> list[LogFault]:
    """Gyro axes that do not turn as the attitude does."""
    turn = rate_of_change(state.rotation, grid.rate)
    skew = np.einsum("nji,njk->nik", state.rotation, turn)
    turning = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    half = max(int(0.1 * grid.rate), 1)
    out = []
    for axis, name in enumerate(("p_rad_s", "q_rad_s", "r_rad_s")):
        gyro, attitude = (running_mean(v[:, axis], half) for v in (state.rates, turning))
        both = flying & np.isfinite(gyro) & np.isfinite(attitude)
        if both.sum() < 100:
            continue
        size = float(gyro[both].std())
        if size > 0.05 and float((gyro - attitude)[both].std()) > DISAGREE * size:
            out.append(LogFault(name, "disagrees with the rate at which the attitude turns"))
    return out


def _mirrored(ctx: Context, grid: Grid, flying: Mask) -> list[LogFault]:
    """Axes on which declared rotor moments oppose the angular acceleration: order mirrored, or spins exchanged."""
    half, wide = max(int(0.05 * grid.rate), 1), max(int(0.5 * grid.rate), 1)
    rates = ctx.state.rates
    out = []
    for axis, what in enumerate(("left and right", "front and back", "clockwise and counter-clockwise")):
        if not flying.any() or float(np.nanstd(ctx.rotor_moment[flying, axis])) < 1e-3 * ctx.weight * ctx.lever:
            continue
        turned = rate_of_change(running_mean(rates[:, axis], half), grid.rate)
        moment = running_mean(ctx.rotor_moment[:, axis], half)
        turned, moment = (v - running_mean(v, wide) for v in (turned, moment))
        found = _strongest(moment, turned, flying, int(0.2 * grid.rate))
        if found < OPPOSED:
            out.append(
                LogFault(
                    "vehicle file",
                    f"declared moments oppose the angular acceleration: {what} are exchanged (r = {found:.2f})",
                )
            )
    return out


def _strongest(cause: Array, effect: Array, flying: Mask, most: int) -> float:
    """Correlation of largest size of an effect 0 to ``most`` samples behind its cause."""
    best = 0.0
    for lag in range(0, most + 1, max(most // 10, 1)):
        a, b = cause[: len(cause) - lag], effect[lag:]
        use = flying[lag:] & np.isfinite(a) & np.isfinite(b)
        if use.sum() < 200:
            continue
        r = float(np.corrcoef(a[use], b[use])[0, 1])
        if np.isfinite(r) and abs(r) > abs(best):
            best = r
    return best


def _crash(state: AirState, grid: Grid) -> int | None:
    """First sample of a log that ends upside down."""
    with np.errstate(invalid="ignore"):
        over = state.rotation[:, 2, 2] < UPSIDE_DOWN
    if over.sum() < 0.3 * grid.rate:
        return None
    first = int(np.argmax(over))
    return first if over[first:].mean() > 0.3 or first > 0.8 * len(over) else None
