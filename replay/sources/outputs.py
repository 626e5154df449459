"""Which port the motors are on, and which of its outputs drives which motor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from models.vehicle.motor_outputs import CAN, DeclaredMotors, declared_motors
from replay.flightlog import FlightLog, MotorOutputs, Series, SourceChoice, Stated
from replay.sources.candidates import Candidate, pick
from replay.sources.imu import correlation
from replay.spill import BLOCK, Spool, blocks

IDLE_US = 30.0
"""An output that never moves by more, of some 1000, drives no motor in flight."""
_LONGEST_US = 2500.0
"""No servo or ESC takes a longer pulse."""
_FOLLOWS = 0.3
"""Correlation with thrust from which on an output counts as one that follows the flight: noise of a hundred samples
reaches 0.3 once in four hundred."""


def choose_outputs(log: FlightLog, wanted: str | None) -> tuple[FlightLog, SourceChoice | None]:
    """The log with ``servo`` and ``motor_outputs`` of the port that drives the motors, and the choice."""
    declared = declared_motors(log.parameters)
    candidates = _candidates(log)
    choice = pick("outputs", candidates, _stated(log, declared), wanted)
    if choice is None:
        return _fallback(log, declared)
    port = next(number for number in log.servo_ports if _name(number) == choice.chosen)
    return _with_port(log, port, _on_port(log, declared, port)), choice


def _with_port(log: FlightLog, port: int, motors: DeclaredMotors | None) -> FlightLog:
    series = log.servo_ports[port]
    used = MotorOutputs(port=port, group=CAN if _is_can(series) else "")
    if motors is not None:
        used = MotorOutputs(port=port, group=motors.group, numbers=motors.numbers)
    return replace(log, servo=series, motor_outputs=used)


def _is_can(series: Series) -> bool:
    """Whether outputs are too large for pulses, as those of CAN ESCs are (0 to 8191).

    Only those that move are asked: an output that is not connected may hold any number.
    """
    columns = [output - 1 for output in moving_outputs(series)]
    used = np.nan_to_num(series.values[:, columns])
    return float(used.max(initial=0.0)) > _LONGEST_US


def _fallback(
    log: FlightLog, declared: Sequence[DeclaredMotors]
) -> tuple[FlightLog, SourceChoice | None]:
    """Where no port moves: what the autopilot asked of each motor, else the first port with what is declared."""
    if log.motor_commands is not None:
        chosen = SourceChoice(
            quantity="outputs",
            chosen=log.motor_commands.source,
            others=tuple(map(_name, log.servo_ports)),
            why="no output of a port moves",
        )
        return replace(log, servo=log.motor_commands), chosen
    if not log.servo_ports:
        return log, None
    return _with_port(log, min(log.servo_ports), declared[0] if declared else None), None


def _candidates(log: FlightLog) -> list[Candidate]:
    thrust = _thrust(log)
    out = []
    for port, series in log.servo_ports.items():
        moving = moving_outputs(series)
        following = [k for k in moving if _follows(series, k, thrust)]
        out.append(
            Candidate(
                name=_name(port),
                fault="" if moving else "no output moves",
                agreement=float(len(following)),
                because="its outputs move with the flight",
            )
        )
    return out


def _stated(log: FlightLog, declared: Sequence[DeclaredMotors]) -> Stated | None:
    """The port on which the declared outputs move."""
    for motors in declared:
        ports = sorted(log.servo_ports, key=lambda port: port != motors.port)
        for port in ports:
            if set(motors.numbers.values()) <= moving_outputs(log.servo_ports[port]):
                return Stated(_name(port), motors.parameter)
    return None


def _on_port(
    log: FlightLog, declared: Sequence[DeclaredMotors], port: int
) -> DeclaredMotors | None:
    """What the parameters say of this port: the driver that belongs to it, else one whose outputs move there."""
    own = next((motors for motors in declared if motors.port == port), None)
    if own is not None:
        return own
    moving = moving_outputs(log.servo_ports[port])
    fits = (motors for motors in declared if set(motors.numbers.values()) <= moving)
    return next(fits, declared[0] if declared else None)


def moving_outputs(series: Series) -> set[int]:
    """Outputs, from 1, that move; 0 is no pulse."""
    low = np.inf
    high = -np.inf
    for rows in blocks(len(series), BLOCK // series.values.shape[1]):
        pulses = series.values[rows]
        known = np.isfinite(pulses) & (pulses > 0.0)
        low = np.minimum(low, np.where(known, pulses, np.inf).min(axis=0))
        high = np.maximum(high, np.where(known, pulses, -np.inf).max(axis=0))
    return {k + 1 for k in np.flatnonzero(np.atleast_1d(high - low) > IDLE_US).tolist()}


def _thrust(log: FlightLog) -> Series | None:
    """What goes with thrust: the command, else the accelerometer along the rotors' axis."""
    if log.thrust_command is not None:
        return log.thrust_command
    if not log.imus:
        return None
    force = log.imus[0].specific_force
    return Series(force.t_s, -force.values[:, 2:3], force.source)


def _follows(series: Series, output: int, thrust: Series | None) -> bool:
    if thrust is None:
        return True
    reference = Spool(np.float64)
    for rows in blocks(len(series)):
        reference.append(thrust.at(series.t_s[rows])[:, 0])
    return correlation(series.values[:, output - 1], reference.array()) > _FOLLOWS


def _name(port: int) -> str:
    return f"port {port}"
