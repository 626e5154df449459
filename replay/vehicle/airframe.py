"""Which multirotor flew: frame, motors, and where their speeds or outputs are in the log.

Parameters say it best; without them the heartbeat's type says how many motors there are, or what turns in the log.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from models.common.errors import LogError
from models.vehicle.ardupilot_frames import (
    SaidFrame,
    said_before_3_5,
    said_by_class,
    said_by_text,
)
from models.vehicle.estimate import pwm_range
from models.vehicle.motor_layouts import FRAMES, UNSURE, Motor
from models.vehicle.px4_frames import px4_rotors, said_by_autostart
from replay.flightlog import FlightLog, Series
from replay.logs.names import called
from replay.sources.outputs import moving_outputs
from replay.vehicle.kinds import other_kind

_COUNT_OF_TYPE = {2: 4, 13: 6, 14: 8, 15: 3, 29: 12, 35: 10}
_MULTIROTORS = {
    2: "a quadrotor",
    13: "a hexarotor",
    14: "an octorotor",
    15: "a tricopter",
    29: "a dodecarotor",
    35: "a decarotor",
}
_USUAL = {4: "quad-x", 6: "hexa-x", 8: "octo-x"}
_ARDUPILOT_OR_PX4 = (3, 12)
_BEYOND = 0.05
"""Outputs this share of their range above its end contradict it."""
TANDEM = "the paper's tandem"
TANDEM_SEEN = "outputs 1 to 4 in pairs, vanes on 5 and 6"
_FRAME_PARAMETERS = {"FRAME_CLASS", "FRAME", "CA_AIRFRAME", "CA_ROTOR_COUNT"}
_NEUTRAL_US = 1500.0
_DEFLECTED_US = 250.0
"""Of the vanes."""
_SAME_US = 2.0
"""The two rotors of a coaxial fan get one output; they differ by rounding."""


@dataclass(frozen=True, kw_only=True)
class Airframe:
    """``motors`` of the frame ``name``; ``numbers``: of each its ESC (``telemetered``) or output, from 1."""

    name: str
    motors: tuple[Motor, ...]
    source: str
    """What says it."""
    unsure: str = ""
    """Why places and spins are not known, or do not say the moments."""
    declared: bool = False
    """Whether parameters or texts of the log say it."""
    arm_m: float | None = None
    """By PX4's parameters."""
    telemetered: bool = False
    numbers: Mapping[int, int] = field(default_factory=dict)

    @property
    def ordered(self) -> bool:
        """Whether places and spins are known, not just the number of motors."""
        return not self.unsure


def airframe(log: FlightLog) -> Airframe:
    """Raises LogError in one line: no multirotor, parameters that contradict the log, or nothing to go by."""
    _refuse_others(log)
    speeds = _speeds(log)
    if not speeds and log.servo is None:
        names = f"{called(log.path, 'rotor speeds')}, {called(log.path, 'outputs')}"
        raise LogError(f"{log.path}: neither rotor speeds nor outputs ({names})")
    moving = _moving(log.servo)
    turning = _turning(log)
    seen = len(turning) or len(moving)
    frame = _frame(log, seen)
    if frame is None:
        raise LogError(
            f"{log.path}: {_said_count(log)}, and {seen} motors turn: which vehicle is this? give "
            "--vehicle"
        )
    numbers = _numbers(log, frame.motors)
    count = len(frame.motors)
    if len(turning) > count:
        raise LogError(
            f"{log.path}: {frame.source}: {count} motors, but {len(turning)} ESCs turn; give "
            "--vehicle"
        )
    by_motor = {m.number: m.number for m in frame.motors}
    in_order = dict(zip(by_motor, sorted(speeds), strict=False))
    for ways in (numbers, by_motor, *([in_order] if len(speeds) == count else [])):
        if set(ways.values()) <= set(speeds):
            return replace(frame, telemetered=True, numbers=ways)
    _check_outputs(log, numbers, moving, frame.source)
    return replace(frame, numbers=numbers)


def turns(log: FlightLog) -> bool:
    """Whether anything shows that motors turned."""
    return bool(_moving(log.servo) or _turning(log))


def _said_count(log: FlightLog) -> str:
    said = _said(log, 0)
    if said is None:
        return "no parameter says the frame"
    return said.said


def what_it_is(log: FlightLog) -> str:
    """What a log shows of its vehicle, in a few words, whether or not one can be drafted from it."""
    kind = other_kind(log)
    if kind is not None:
        return f"{kind.what} ({kind.said})"
    try:
        frame = _frame(log, 0)
    except LogError:
        return "a vehicle of which the log contradicts itself"
    if frame is not None and frame.declared:
        return frame.name
    return _MULTIROTORS.get(log.vehicle_type or 0, "a vehicle that the log does not name")


def _refuse_others(log: FlightLog) -> None:
    kind = other_kind(log)
    if kind is not None:
        raise LogError(f"{log.path}: {kind.said} is {kind.what}; only multirotors are drafted")


def _frame(log: FlightLog, seen: int) -> Airframe | None:
    """The frame without ``numbers``, of which ``seen`` motors turn; None where nothing says how many there are."""
    count = _COUNT_OF_TYPE.get(log.vehicle_type or 0)
    rotors = px4_rotors(log.parameters)
    if rotors is not None:
        return Airframe(
            name=rotors.name,
            motors=rotors.motors,
            source="CA_ROTORn_PX, _PY, _KM",
            unsure=rotors.unsure,
            declared=True,
            arm_m=rotors.arm_m,
        )
    said = _said(log, count or seen)
    if said is not None:
        if None not in (said.count, count) and said.count != count:
            if ", " in said.said:
                verb = "have"
            else:
                verb = "has"
            raise LogError(
                f"{log.path}: {said.said} {verb} {said.count} motors, and MAV_TYPE "
                f"{log.vehicle_type} has {count}; give --vehicle"
            )
        return _of_firmware(said, said.count or count or seen)
    if count is None:
        said_by = "no parameter says the frame"
    else:
        said_by = f"MAV_TYPE {log.vehicle_type}"
    usual = _USUAL.get(count or seen)
    if usual is None:
        return _unknown(count or seen, said_by, "no parameter says the frame")
    if log.autopilot in _ARDUPILOT_OR_PX4:
        unsure = ""
    else:
        unsure = "no parameter says the frame"
    return Airframe(
        name=usual, motors=FRAMES[usual], source=f"{said_by}: the usual {usual}", unsure=unsure
    )


def _said(log: FlightLog, count: int) -> SaidFrame | None:
    """What parameters and texts say of the frame, the surest first."""
    texts = [text for _, _, text in log.texts]
    return (
        said_by_class(log.parameters)
        or said_before_3_5(log.parameters, texts, count)
        or said_by_text(texts)
        or said_by_autostart(log.parameters)
    )


def _of_firmware(said: SaidFrame, count: int) -> Airframe | None:
    if said.name is None:
        return _unknown(count, said.said, said.unsure, declared=True)
    motors = FRAMES[said.name]
    unsure = said.unsure or UNSURE.get(said.name, "")
    return Airframe(
        name=said.name,
        motors=motors,
        source=said.said + _yaw_words(motors),
        unsure=unsure,
        declared=True,
    )


def _yaw_words(motors: tuple[Motor, ...]) -> str:
    """Said where the mixer steers yaw with some motors more than with others."""
    ahead = {motor.yaw for motor in motors if motor.forward > 0.0}
    behind = {motor.yaw for motor in motors if motor.forward < 0.0}
    if ahead == behind:
        return ""
    return f" (yaw factors {max(ahead):g} ahead, {max(behind):g} behind)"


def _unknown(count: int, said: str, why: str, *, declared: bool = False) -> Airframe | None:
    """So many motors, evenly spaced."""
    if not 2 <= count <= 12:
        return None
    return Airframe(
        name=f"{count} rotors", motors=_ring(count), source=said, unsure=why, declared=declared
    )


def _ring(count: int) -> tuple[Motor, ...]:
    angles = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    return tuple(
        Motor(number=k, forward=float(np.cos(a)), right=float(np.sin(a)), spin=1 if k % 2 else -1)
        for k, a in enumerate(angles, 1)
    )


def _numbers(log: FlightLog, motors: tuple[Motor, ...]) -> dict[int, int]:
    """Motor number to output; the parameters name every motor or none, then numbers are the same.

    So they are for motors whose parameters did not arrive: a ground station may have left before the list was complete.
    """
    declared = log.motor_outputs.numbers
    lacking = ", ".join(str(m.number) for m in motors if m.number not in declared)
    arrived = len(log.parameters) >= log.parameters_expected
    if declared and lacking and arrived:
        raise LogError(
            f"{log.path}: the parameters give motor {lacking} of {len(motors)} no output "
            "(SERVOn_FUNCTION, PWM_MAIN_FUNCn, PWM_AUX_FUNCn); give --vehicle"
        )
    return {motor.number: declared.get(motor.number, motor.number) for motor in motors}


def _moving(servo: Series | None) -> Collection[int]:
    """Outputs, from 1, that move."""
    if servo is None:
        return set()
    return moving_outputs(servo)


def _turning(log: FlightLog) -> set[int]:
    """ESCs, from 1, that turn."""
    return {
        number
        for number, rpm in _speeds(log).items()
        if np.nan_to_num(rpm.values).max(initial=0.0) > 0.0
    }


def _speeds(log: FlightLog) -> dict[int, Series]:
    """By ESC, from 1."""
    return {number: esc.rpm for number, esc in log.escs.items() if esc.rpm is not None}


def _check_outputs(
    log: FlightLog, numbers: Mapping[int, int], moving: Collection[int], source: str
) -> None:
    still = sorted(set(numbers.values()) - set(moving))
    if len(still) == len(numbers):
        raise LogError(f"{log.path}: no output of a motor moves: the vehicle did not fly")
    if still:
        on = ", ".join(map(str, numbers.values()))
        raise LogError(
            f"{log.path}: {source}: motors on outputs {on}, but output {still[0]} never moves"
        )
    assert log.servo is not None
    low, high, key = pwm_range(log.parameters, min(numbers.values()), log.motor_outputs.group)
    used = log.servo.values[:, [n - 1 for n in numbers.values()]]
    most = float(np.nanpercentile(used, 99.0))
    if key and most > high + _BEYOND * (high - low):
        raise LogError(
            f"{log.path}: {key} says {high:g} us at most, and the motors' outputs reach "
            f"{most:.0f} us"
        )


def is_tandem(log: FlightLog) -> bool:
    """Whether rotors 1 and 2, and 3 and 4, get one output each, and two vanes move about their middle.

    No parameter of an autopilot says such a frame.
    """
    if log.servo is None or _FRAME_PARAMETERS & set(log.parameters):
        return False
    outputs = log.servo.values[(log.servo.values[:, :6] > 0.0).all(axis=1)]
    if len(outputs) < 0.5 * len(log.servo):
        return False
    pairs = np.abs(outputs[:, [0, 2]] - outputs[:, [1, 3]]).max() <= _SAME_US
    vanes = outputs[:, 4:6]
    moved = np.ptp(vanes, axis=0).min() > 0.0 and np.abs(vanes - _NEUTRAL_US).max() < _DEFLECTED_US
    return bool(pairs and moved)
