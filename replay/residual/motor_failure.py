"""Motors that fail in flight, in words: which, from when on, and what shows it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from models.effects import Context
from models.vehicle import Vehicle
from models.vehicle.motor_outputs import declared_motors
from replay.flightlog import FlightLog, LogFault, MotorLoss
from replay.residual.failed_motor import Failure, failed_motor, places_known
from replay.residual.grid import Mask
from replay.residual.lost_speed import SLOW_SHARE, Lost, lost_speed, switched_off
from replay.residual.motion import Trajectory
from replay.residual.motor_signals import evidence_until

WITHIN_S = 1.0
"""After a beginning, in which output and turning are described."""
BEFORE_S = 0.3
ANSWERS = 0.15
"""So long before a beginning the outputs are still as usual; and by which share of them above idle one rises."""
ALL_LOST = 0.85
"""Share of the thrust from which on it is all lost: what is left cannot be told from none."""
SEEN_SURE = 0.97
"""Probability of a motor that its speed or output gives away. In 90 simulated failures with speeds in the log 81 were
named, all rightly (failing_fan.py, seeds 77, 501, 902): 82 of 83 by Laplace. Real logs have faults that these lack."""
TURNS_RAD_S = 0.3
"""Rate from which on the vehicle is said to turn."""
ASIDE = 0.3
"""Share of the arm from which on a motor is ahead, behind, or on a side."""


@dataclass(frozen=True)
class _At:
    """What the words need."""

    ctx: Context
    motion: Trajectory
    since_s: float

    @property
    def seconds(self) -> Mask:
        """Samples (n,) right after the beginning."""
        t = self.motion.grid.t
        return np.asarray((t >= self.since_s) & (t <= self.since_s + WITHIN_S))


def motor_faults(log: FlightLog, ctx: Context, motion: Trajectory, flying: Mask) -> list[LogFault]:
    """What is said of motors that fail: the surest sign first, and the first failure only."""
    reassigned = _reassigned(log, ctx, flying)
    if reassigned:
        return reassigned
    if not flying.any():
        return []
    until_s = evidence_until(ctx, motion, flying)
    off = switched_off(log, ctx, flying, until_s)
    if off is not None:
        return [_switched_off(_At(ctx, motion, off.since_s), off)]
    lost = lost_speed(ctx, flying, until_s)
    if lost is not None:
        return [_lost_speed(_At(ctx, motion, lost.since_s), lost)]
    failure = failed_motor(ctx, motion, flying)
    if failure is None:
        return []
    return [_no_thrust(_At(ctx, motion, failure.since_s), failure)]


def _reassigned(log: FlightLog, ctx: Context, flying: Mask) -> list[LogFault]:
    """Motors whose output a parameter took away in flight."""
    t = ctx.state.time_s
    flown = t[flying]
    parameters = dict(log.parameters)
    at_take_off = _outputs(parameters)
    out = []
    gone: set[int] = set()
    for change in log.parameter_changes:
        parameters[change.name] = change.after
        left = _outputs(parameters)
        for motor, output in at_take_off.items():
            if left.get(motor) == output or motor in gone:
                continue
            if not flown.size or not flown[0] < change.t_s <= flown[-1]:
                continue
            gone.add(motor)
            fan = _fan_of_output(ctx.vehicle, output)
            where = _where(ctx.vehicle, fan, output)
            what = (
                f"motor {motor}{where} is switched off from {change.t_s:.1f} s on: {change.name} "
                "was set to "
            )
            what += f"{change.after:g} (before: {change.before:g})"
            # In the vehicle file a fan may stand at another place than its motor's number.
            number = motor if fan is None else fan + 1
            out.append(_seen(f"servo_{output}", what, change.t_s, number))
    return out


def _outputs(parameters: Mapping[str, float]) -> dict[int, int]:
    """Motor to output, by all drivers; those with most motors count."""
    out: dict[int, int] = {}
    for driver in reversed(declared_motors(parameters)):
        out |= driver.numbers
    return out


def _fan_of_output(vehicle: Vehicle, output: int) -> int | None:
    for k, fan in enumerate(vehicle.fans):
        if any(output in (rotor.servo, rotor.esc) for rotor in fan.rotors):
            return k
    return None


def _switched_off(at: _At, off: Lost) -> LogFault:
    fan = at.ctx.vehicle.rotor_fan[off.rotor]
    output = _output(at.ctx.vehicle, fan)
    named = f"motor {fan + 1}{_where(at.ctx.vehicle, fan, output)}"
    what = (
        f"{named} is switched off from {at.since_s:.1f} s on: its output falls below what a motor "
        "gets in flight"
    )
    return _seen(f"servo_{output}", what, at.since_s, fan + 1)


def _seen(channel: str, what: str, since_s: float, motor: int, least: float = ALL_LOST) -> LogFault:
    """A motor whose speed or output says that it has lost this share of its thrust at least, and at most all."""
    loss = MotorLoss(
        motors=(motor,),
        share=0.5 * (least + 1.0),
        interval=(least, 1.0),
        probability=SEEN_SURE,
    )
    return LogFault(channel, what, since_s, loss)


def _lost_speed(at: _At, lost: Lost) -> LogFault:
    fan = at.ctx.vehicle.rotor_fan[lost.rotor]
    number = _output(at.ctx.vehicle, fan)
    named = f"motor {fan + 1}{_where(at.ctx.vehicle, fan, number)}"
    speed = float(np.nanmedian(at.ctx.state.rpm[at.seconds, lost.rotor]))
    if not lost.faster and not _answered(at, number):
        what = (
            f"falls to {speed:.0f} rpm from {at.since_s:.1f} s on and its output does not answer: "
            "telemetry is lost"
        )
        return LogFault(f"rpm_{number}", what, since_s=at.since_s)
    least = ALL_LOST
    if lost.faster:
        how = (
            f"turns without load from {at.since_s:.1f} s on ({speed:.0f} rpm): its propeller "
            "is gone"
        )
    elif speed < 0.05 * float(np.nanmedian(at.ctx.state.rpm)):
        how = f"stands from {at.since_s:.1f} s on"
    else:
        # Thrust goes with the square of the speed.
        least = 1.0 - SLOW_SHARE**2
        how = (
            f"does not follow its output from {at.since_s:.1f} s on ({speed:.0f} rpm): it stalls, "
            "or lost step"
        )
    return _seen(f"rpm_{number}", named + " " + how + _signs(at, fan), at.since_s, fan + 1, least)


def _answered(at: _At, output: int) -> bool:
    """Whether the autopilot drives a motor harder after a beginning, as it does where thrust is lost."""
    t = at.motion.grid.t
    pulses = at.ctx.state.servo_us[:, output - 1]
    before = pulses[(t > at.since_s - WITHIN_S) & (t < at.since_s - BEFORE_S)]
    after = pulses[at.seconds]
    if not np.isfinite(before).any() or not np.isfinite(after).any():
        return False
    usual = float(np.nanmedian(before))
    idle = float(np.nanmin(pulses))
    return float(np.nanmax(after)) - usual > ANSWERS * max(usual - idle, 1.0)


def _no_thrust(at: _At, failure: Failure) -> LogFault:
    vehicle = at.ctx.vehicle
    if failure.share >= ALL_LOST:
        loses = "no thrust"
    else:
        loses = f"about {failure.share:.0%} less thrust"
    outputs = [_output(vehicle, fan) for fan in failure.fans]
    named = [
        f"{fan + 1}{_where(vehicle, fan, output)}"
        for fan, output in zip(failure.fans, outputs, strict=True)
    ]
    if len(named) == 1:
        who = f"motor {named[0]}"
    else:
        who = f"one of motors {' and '.join(named)}"
    what = f"{who} gives {loses} from {at.since_s:.1f} s on{_signs(at, failure.fans[0])}"
    spread = 1.96 * failure.share_sd
    loss = MotorLoss(
        motors=tuple(fan + 1 for fan in failure.fans),
        share=failure.share,
        interval=(max(failure.share - spread, 0.0), min(failure.share + spread, 1.0)),
        probability=failure.probability,
        explains=failure.explains,
    )
    return LogFault(f"servo_{outputs[0]}", what, at.since_s, loss)


def _signs(at: _At, fan: int) -> str:
    """What the output does and how the vehicle turns, as a pilot sees it; empty where neither says anything."""
    output = _output(at.ctx.vehicle, fan)
    after = at.seconds
    said = []
    if output <= at.ctx.state.servo_us.shape[1]:
        pulses = at.ctx.state.servo_us[after, output - 1]
        t = at.motion.grid.t
        before = at.ctx.state.servo_us[
            (t > at.since_s - WITHIN_S) & (t < at.since_s - 0.1), output - 1
        ]
        if np.isfinite(pulses).any() and np.isfinite(before).any():
            top = float(np.nanmax(pulses))
            if top > float(np.nanmedian(before)) + 20.0:
                said.append(f"its output rises to {top:.0f} us")
    rates = at.motion.gyro[after]
    if np.isfinite(rates).any():
        p = float(rates[int(np.nanargmax(np.abs(rates[:, 0]))), 0])
        q = float(rates[int(np.nanargmax(np.abs(rates[:, 1]))), 1])
        if abs(p) > max(abs(q), TURNS_RAD_S):
            said.append(f"the vehicle rolls {'right' if p > 0.0 else 'left'}")
        elif abs(q) > TURNS_RAD_S:
            said.append(f"the vehicle pitches {'up' if q > 0.0 else 'down'}")
    if said:
        return ": " + " while ".join(said)
    return ""


def _output(vehicle: Vehicle, fan: int) -> int:
    rotor = vehicle.fans[fan].rotors[0]
    return rotor.servo or rotor.esc or fan + 1


def _where(vehicle: Vehicle, fan: int | None, output: int) -> str:
    """`` (rear right, output 4)``; only the output where places are not known."""
    number = f"output {output}"
    if fan is None or not places_known(vehicle):
        return f" ({number})"
    places = np.asarray(vehicle.fan_positions_m)[:, :2]
    arm = float(np.linalg.norm(places, axis=1).max())
    x, y = (places[fan] / max(arm, 1e-9)).tolist()
    words = []
    if abs(x) > ASIDE:
        words.append("front" if x > 0.0 else "rear")
    if abs(y) > ASIDE:
        words.append("right" if y > 0.0 else "left")
    return f" ({' '.join(words) or 'middle'}, {number})"
