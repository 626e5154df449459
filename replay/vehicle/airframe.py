"""Which multirotor flew: frame, motors, and where their speeds or outputs are in the log.

Parameters say it best; without them the heartbeat's type says how many motors there are, or what turns in the log.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from models.errors import LogError
from models.vehicle_setup.estimate import pwm_range
from models.vehicle_setup.motor_layouts import FRAMES, Motor, ardupilot_frame, px4_motors
from replay.flightlog import FlightLog, Series
from replay.sources.outputs import moving_outputs

_OTHERS = {
    "MAV_TYPE": {
        1: "an aeroplane", 4: "a helicopter", 7: "an airship", 8: "a balloon", 10: "a rover", 11: "a boat",
        12: "a submarine", **dict.fromkeys(range(19, 26), "a VTOL aeroplane"),
    },
    "FRAME_CLASS": dict.fromkeys((6, 11, 13), "a helicopter"),
    "CA_AIRFRAME": {
        1: "an aeroplane", **dict.fromkeys((2, 3, 4), "a VTOL aeroplane"), **dict.fromkeys((5, 6, 13), "a rover"),
        7: "a submarine", **dict.fromkeys((10, 11, 12), "a helicopter"), 14: "a spacecraft", 15: "a spacecraft",
    },
    "Q_ENABLE": {1: "a VTOL aeroplane"},
}  # fmt: skip
"""What is no multirotor, by parameter or heartbeat: MAVLink's MAV_TYPE, ArduPilot's and PX4's own numbers."""
_FIRMWARES = ("ArduPlane", "APM:Plane", "ArduRover", "APM:Rover", "Rover V", "ArduSub", "Blimp")
_COUNT_OF_TYPE = {2: 4, 13: 6, 14: 8, 15: 3, 29: 12, 35: 10}
_COUNT_OF_CLASS = {1: 4, 2: 6, 3: 8, 4: 8, 5: 6, 7: 3, 12: 12, 14: 10}
_USUAL = {4: "quad-x", 6: "hexa-x", 8: "octo-x"}
_ARDUPILOT_OR_PX4 = (3, 12)
_BEYOND = 0.05
"""Outputs this share of their range above its end contradict it."""
TANDEM = "the paper's tandem"
TANDEM_SEEN = "outputs 1 to 4 in pairs, vanes on 5 and 6"
_FRAME_PARAMETERS = {"FRAME_CLASS", "FRAME", "CA_AIRFRAME", "CA_ROTOR_COUNT"}
_NEUTRAL_US, _DEFLECTED_US = 1500.0, 250.0
"""Of the vanes."""
_SAME_US = 2.0
"""The two rotors of a coaxial fan get one output; they differ by rounding."""


@dataclass(frozen=True)
class Airframe:
    """``motors`` of the frame ``name``; ``numbers``: of each its ESC (``telemetered``) or output, from 1."""

    name: str
    motors: tuple[Motor, ...]
    source: str
    """What says it."""
    ordered: bool = True
    """Whether places and spins are known, not just the number of motors."""
    arm_m: float | None = None
    """By PX4's parameters."""
    telemetered: bool = False
    numbers: Mapping[int, int] = field(default_factory=dict)

    @property
    def declared(self) -> bool:
        """Whether parameters of the log say it."""
        return self.source.startswith(("FRAME", "CA_ROTOR"))


def airframe(log: FlightLog) -> Airframe:
    """Raises LogError in one line: no multirotor, parameters that contradict the log, or nothing to go by."""
    _refuse_others(log)
    speeds = _speeds(log)
    if not speeds and log.servo is None:
        raise LogError(f"{log.path}: neither rotor speeds nor outputs (ESC_TELEMETRY, ESC_STATUS, SERVO_OUTPUT_RAW)")
    moving, turning = _moving(log.servo), _turning(log)
    frame = _frame(log, len(turning) or len(moving))
    numbers = _numbers(log, frame.motors)
    count = len(frame.motors)
    if len(turning) > count:
        raise LogError(f"{log.path}: {frame.source}: {count} motors, but {len(turning)} ESCs turn; give --vehicle")
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


def _refuse_others(log: FlightLog) -> None:
    for key, kinds in _OTHERS.items():
        value = log.parameters.get(key, log.vehicle_type if key == "MAV_TYPE" else None)
        if value in kinds:
            raise LogError(f"{log.path}: {key} {value:g} is {kinds[int(value)]}; only multirotors are drafted")
    for _, _, text in log.texts:
        if text.startswith(_FIRMWARES):
            raise LogError(f"{log.path}: '{text}' flies no multirotor; only multirotors are drafted")


def _frame(log: FlightLog, seen: int) -> Airframe:
    """The frame without ``numbers``; ``seen`` motors turn."""
    p, kind = log.parameters, log.vehicle_type
    count = _COUNT_OF_TYPE.get(kind or 0)
    declared = px4_motors(p)
    if declared is not None:
        return Airframe("of PX4's parameters", declared[0], "CA_ROTORn_PX, _PY, _KM", arm_m=declared[1])
    name, said = None, "no parameter says the frame" if count is None else f"MAV_TYPE {kind}"
    if "FRAME_CLASS" in p:
        said = f"FRAME_CLASS {p['FRAME_CLASS']:g}, FRAME_TYPE {p.get('FRAME_TYPE', 0):g}"
        own = _COUNT_OF_CLASS.get(int(p["FRAME_CLASS"]))
        if own is not None and count not in (None, own):
            raise LogError(f"{log.path}: {said} have {own} motors, and MAV_TYPE {kind} has {count}; give --vehicle")
        name, count = ardupilot_frame(p), own or count
    elif count == 4 and "FRAME" in p:  # before ArduCopter 3.5
        name, said = ardupilot_frame({"FRAME_CLASS": 1.0, "FRAME_TYPE": p["FRAME"]}), f"FRAME {p['FRAME']:g}"
    elif (count or seen) in _USUAL:
        usual = _USUAL[count or seen]
        return Airframe(usual, FRAMES[usual], f"{said}: the usual {usual}", log.autopilot in _ARDUPILOT_OR_PX4)
    if name is not None:
        return Airframe(name, FRAMES[name], said)
    count = count or seen
    if not 2 <= count <= 12:
        raise LogError(f"{log.path}: {said}, and {seen} motors turn: which vehicle is this? give --vehicle")
    return Airframe(f"{count} rotors", _ring(count), said, ordered=False)


def _ring(count: int) -> tuple[Motor, ...]:
    """Places of a frame that is not known: evenly spaced."""
    angles = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    return tuple(Motor(k, float(np.cos(a)), float(np.sin(a)), 1 if k % 2 else -1) for k, a in enumerate(angles, 1))


def _numbers(log: FlightLog, motors: tuple[Motor, ...]) -> dict[int, int]:
    """Motor number to output; the parameters name every motor or none, then numbers are the same."""
    declared = log.motor_outputs.numbers
    lacking = ", ".join(str(m.number) for m in motors if m.number not in declared)
    if declared and lacking:
        raise LogError(
            f"{log.path}: the parameters give motor {lacking} of {len(motors)} no output "
            "(SERVOn_FUNCTION, PWM_MAIN_FUNCn, PWM_AUX_FUNCn); give --vehicle"
        )
    return {motor.number: declared.get(motor.number, motor.number) for motor in motors}


def _moving(servo: Series | None) -> Collection[int]:
    """Outputs, from 1, that move."""
    return set() if servo is None else moving_outputs(servo)


def _turning(log: FlightLog) -> set[int]:
    """ESCs, from 1, that turn."""
    return {number for number, rpm in _speeds(log).items() if np.nan_to_num(rpm.values).max(initial=0.0) > 0.0}


def _speeds(log: FlightLog) -> dict[int, Series]:
    """By ESC, from 1."""
    return {number: esc.rpm for number, esc in log.escs.items() if esc.rpm is not None}


def _check_outputs(log: FlightLog, numbers: Mapping[int, int], moving: Collection[int], source: str) -> None:
    still = sorted(set(numbers.values()) - set(moving))
    if len(still) == len(numbers):
        raise LogError(f"{log.path}: no output of a motor moves: the vehicle did not fly")
    if still:
        on = ", ".join(map(str, numbers.values()))
        raise LogError(f"{log.path}: {source}: motors on outputs {on}, but output {still[0]} never moves")
    assert log.servo is not None
    low, high, key = pwm_range(log.parameters, min(numbers.values()), log.motor_outputs.group)
    used = log.servo.values[:, [n - 1 for n in numbers.values()]]
    most = float(np.nanpercentile(used, 99.0))
    if key and most > high + _BEYOND * (high - low):
        raise LogError(f"{log.path}: {key} says {high:g} us at most, and the motors' outputs reach {most:.0f} us")


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
