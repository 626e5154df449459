"""Frames: where each motor sits and how it turns, by the motor numbers of ArduPilot and PX4.

Sources: ArduPilot ``AP_MotorsMatrix.cpp`` of 4.6 (angles clockwise from the nose, roll and pitch factors, spin by the
sign of the yaw factor) and ``AP_MotorsTri.cpp``; PX4 1.12 ``MultirotorMixer/geometries``. Quad X, hexa, octo and X8
have the same numbers on both.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

CW = 1
CCW = -1


@dataclass(frozen=True, kw_only=True)
class Motor:
    """Motor ``number`` from 1, its place over the arm's length (forward, right), and its spin seen from above."""

    number: int
    forward: float
    right: float
    spin: int
    down: float = 0.0
    """Below the frame's plane, over the arm's length; known on PX4 only."""
    yaw: float = 1.0
    """Share of a yaw command that the mixer gives to it, the strongest motor being 1."""


Frame = tuple[Motor, ...]


def _ring(angle_spin: Sequence[tuple[float, int]]) -> Frame:
    """Motors by angle [deg] clockwise from the nose."""
    return tuple(_at(k, angle, spin) for k, (angle, spin) in enumerate(angle_spin, 1))


def _at(number: int, angle: float, spin: int) -> Motor:
    radians = math.radians(angle)
    return Motor(
        number=number,
        forward=round(math.cos(radians), 9),
        right=round(math.sin(radians), 9),
        spin=spin,
    )


def _placed(places: Sequence[tuple[float, float, int]]) -> Frame:
    """Motors by (forward, right, spin) in any unit of length."""
    arm = max(math.hypot(x, y) for x, y, _ in places)
    numbered = enumerate(places, 1)
    return tuple(
        Motor(number=k, forward=x / arm, right=y / arm, spin=spin) for k, (x, y, spin) in numbered
    )


def _reversed(motors: Frame) -> Frame:
    return tuple(replace(motor, spin=-motor.spin) for motor in motors)


def _weak_front(motors: Frame, yaw: float) -> Frame:
    """The motors ahead get this share of a yaw command."""
    return tuple(replace(m, yaw=yaw) if m.forward > 0.0 else m for m in motors)


def _no_yaw(motors: Frame) -> Frame:
    return tuple(replace(motor, yaw=0.0) for motor in motors)


def _numbered(motors: Frame, numbers: Iterable[int]) -> Frame:
    paired = zip(motors, numbers, strict=True)
    return tuple(replace(motor, number=number) for motor, number in paired)


_V_YAW = 0.7981
"""Yaw factor of the front motors of a V: their arms reach further out than those behind."""
_QUAD_X = _ring([(45, CCW), (-135, CCW), (-45, CW), (135, CW)])
_QUAD_PLUS = _ring([(90, CCW), (-90, CCW), (0, CW), (180, CW)])
_QUAD_BF = _ring([(135, CW), (45, CCW), (-135, CCW), (-45, CW)])
_V_TAIL = _weak_front(_ring([(60, CW), (-160, CW), (-60, CCW), (160, CCW)]), 0.0)
_TRI = _no_yaw(_ring([(60, CW), (-60, CCW), (180, CW)]))
_X8 = _ring(
    [(45, CCW), (-45, CW), (-135, CCW), (135, CW), (-45, CCW), (45, CW), (135, CCW), (-135, CW)]
)
_X8_BF = _ring(
    [(135, CW), (45, CCW), (-135, CCW), (-45, CW), (135, CCW), (45, CW), (-135, CW), (-45, CCW)]
)

FRAMES: dict[str, Frame] = {
    "quad-x": _QUAD_X,
    "quad-v": _weak_front(_QUAD_X, _V_YAW),
    "quad-h": _reversed(_QUAD_X),
    "quad-vtail": _V_TAIL,
    "quad-atail": _reversed(_V_TAIL),
    "quad-y4": _placed([(1, 1, CCW), (-1, 0, CW), (-1, 0, CCW), (1, -1, CW)]),
    "quad-bf": _QUAD_BF,
    "quad-bf-reversed": _reversed(_QUAD_BF),
    "quad-dji": _ring([(45, CCW), (-45, CW), (-135, CCW), (135, CW)]),
    "quad-clockwise": _ring([(45, CCW), (135, CW), (-135, CCW), (-45, CW)]),
    "quad-plus": _QUAD_PLUS,
    "quad-plus-reversed": _reversed(_QUAD_PLUS),
    "quad-x-no-yaw-torque": _no_yaw(_QUAD_X),
    "quad-plus-no-yaw-torque": _no_yaw(_QUAD_PLUS),
    "quad-wide": _placed([
        (0.1515, 0.245, CCW), (-0.1515, -0.1875, CCW), (0.1515, -0.245, CW), (-0.1515, 0.1875, CW)
    ]),
    "quad-deadcat": _placed([
        (0.1155, 0.245, CCW), (-0.1875, -0.1875, CCW), (0.1155, -0.245, CW), (-0.1875, 0.1875, CW)
    ]),
    "tri": _numbered(_TRI, (1, 2, 4)),
    "tri-reversed": _numbered(_no_yaw(_ring([(120, CW), (-120, CCW), (0, CW)])), (1, 2, 4)),
    "px4-tri": _TRI,
    "hexa-x": _ring([(90, CW), (-90, CCW), (-30, CW), (150, CCW), (30, CCW), (-150, CW)]),
    "hexa-plus": _ring([(0, CW), (180, CCW), (-120, CW), (60, CCW), (-60, CCW), (120, CW)]),
    "hexa-h": _placed([(0, 1, CW), (0, -1, CCW), (1, -1, CW), (-1, 1, CCW), (1, 1, CCW), (-1, -1, CW)]),
    "hexa-dji": _ring([(30, CCW), (-30, CW), (-90, CCW), (-150, CW), (150, CCW), (90, CW)]),
    "hexa-clockwise": _ring([(30, CCW), (90, CW), (150, CCW), (-150, CW), (-90, CCW), (-30, CW)]),
    "octo-x": _ring([
        (22.5, CW), (-157.5, CW), (67.5, CCW), (157.5, CCW), (-22.5, CCW), (-112.5, CCW), (-67.5, CW), (112.5, CW)
    ]),
    "octo-plus": _ring([(0, CW), (180, CW), (45, CCW), (135, CCW), (-45, CCW), (-135, CCW), (-90, CW), (90, CW)]),
    "octo-v": _placed([
        (0.34, -0.83, CW), (-0.32, 0.67, CW), (-0.32, -0.67, CCW), (-1, 0.5, CCW),
        (1, -1, CCW), (0.34, 0.83, CCW), (1, 1, CW), (-1, -0.5, CW),
    ]),
    "octo-h": _placed([
        (1, 1, CW), (-1, -1, CW), (0.333, 1, CCW), (-1, 1, CCW),
        (1, -1, CCW), (-0.333, -1, CCW), (0.333, -1, CW), (-0.333, 1, CW),
    ]),
    "octo-i": _placed([
        (-1, -0.333, CW), (1, 0.333, CW), (-1, -1, CCW), (1, -0.333, CCW),
        (-1, 0.333, CCW), (1, 1, CCW), (-1, 1, CW), (1, -1, CW),
    ]),
    "octo-dji": _ring([
        (22.5, CCW), (-22.5, CW), (-67.5, CCW), (-112.5, CW), (-157.5, CCW), (157.5, CW), (112.5, CCW), (67.5, CW)
    ]),
    "octo-clockwise": _ring([
        (22.5, CCW), (67.5, CW), (112.5, CCW), (157.5, CW), (-157.5, CCW), (-112.5, CW), (-67.5, CCW), (-22.5, CW)
    ]),
    "y6": _ring([(60, CCW), (-60, CW), (-60, CCW), (180, CW), (60, CW), (180, CCW)]),
    "y6b": _ring([(60, CW), (60, CCW), (180, CW), (180, CCW), (-60, CW), (-60, CCW)]),
    "y6f": _ring([(180, CCW), (60, CCW), (-60, CCW), (180, CW), (60, CW), (-60, CW)]),
    "octaquad-x": _X8,
    "octaquad-v": _weak_front(_X8, _V_YAW),
    "octaquad-h": _reversed(_X8),
    "octaquad-plus": _ring([
        (0, CCW), (-90, CW), (180, CCW), (90, CW), (-90, CCW), (0, CW), (90, CCW), (180, CW)
    ]),
    "octaquad-clockwise": _ring([
        (45, CCW), (45, CW), (135, CW), (135, CCW), (-135, CCW), (-135, CW), (-45, CW), (-45, CCW)
    ]),
    "octaquad-bf": _X8_BF,
    "octaquad-bf-reversed": _reversed(_X8_BF),
    "octaquad-x-corotating": _ring([
        (45, CCW), (-45, CW), (-135, CCW), (135, CW), (-45, CW), (45, CCW), (135, CW), (-135, CCW)
    ]),
    "octaquad-clockwise-corotating": _ring([
        (45, CCW), (45, CCW), (135, CW), (135, CW), (-135, CCW), (-135, CCW), (-45, CW), (-45, CW)
    ]),
    "deca-plus": _ring([
        (0, CCW), (36, CW), (72, CCW), (108, CW), (144, CCW),
        (180, CW), (-144, CCW), (-108, CW), (-72, CCW), (-36, CW),
    ]),
    "deca-x": _ring([
        (18, CCW), (54, CW), (90, CCW), (126, CW), (162, CCW),
        (-162, CW), (-126, CCW), (-90, CW), (-54, CCW), (-18, CW),
    ]),
    "dodecahexa-plus": _ring([
        (0, CCW), (0, CW), (60, CW), (60, CCW), (120, CCW), (120, CW),
        (180, CW), (180, CCW), (-120, CCW), (-120, CW), (-60, CW), (-60, CCW),
    ]),
    "dodecahexa-x": _ring([
        (30, CCW), (30, CW), (90, CW), (90, CCW), (150, CCW), (150, CW),
        (-150, CW), (-150, CCW), (-90, CCW), (-90, CW), (-30, CW), (-30, CCW),
    ]),
}  # fmt: skip
"""Motor 1 first. Two motors in one place are one coaxial fan (``octaquad-x``, also called X8)."""

_TILTED = "its rear rotors are tilted by an angle that no parameter says"
_TAIL_SERVO = "a servo tilts its tail rotor"
_NO_TORQUE = "no parameter says how its rotors turn"
UNSURE: dict[str, str] = {
    "quad-vtail": _TILTED,
    "quad-atail": _TILTED,
    "tri": _TAIL_SERVO,
    "tri-reversed": _TAIL_SERVO,
    "px4-tri": _TAIL_SERVO,
    "quad-x-no-yaw-torque": _NO_TORQUE,
    "quad-plus-no-yaw-torque": _NO_TORQUE,
}
"""Why places and spins do not say the moments of these frames."""
