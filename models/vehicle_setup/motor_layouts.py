"""Standard frames: where each motor sits and how it turns, by the motor numbers of ArduPilot and PX4.

Sources: ArduPilot AP_MotorsMatrix.cpp (angles clockwise from the nose, spin by yaw factor); PX4 control allocation
(CA_ROTORn_PX, PY, KM; KM above 0 turns counter-clockwise seen from above). Quad X has the same numbers on both.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

CW, CCW = 1, -1


@dataclass(frozen=True)
class Motor:
    """Motor ``number`` from 1, its place over the arm's length (forward, right), and its spin seen from above."""

    number: int
    forward: float
    right: float
    spin: int
    down: float = 0.0
    """Below the frame's plane, over the arm's length; known on PX4 only."""


def _ring(*angle_spin: tuple[float, int]) -> tuple[Motor, ...]:
    return tuple(
        Motor(k, round(math.cos(math.radians(a)), 9), round(math.sin(math.radians(a)), 9), spin)
        for k, (a, spin) in enumerate(angle_spin, 1)
    )


FRAMES: dict[str, tuple[Motor, ...]] = {
    "quad-x": _ring((45, CCW), (-135, CCW), (-45, CW), (135, CW)),
    "quad-h": _ring((45, CW), (-135, CW), (-45, CCW), (135, CCW)),
    "quad-bf": _ring((135, CW), (45, CCW), (-135, CCW), (-45, CW)),
    "quad-bf-reversed": _ring((135, CCW), (45, CW), (-135, CW), (-45, CCW)),
    "quad-dji": _ring((45, CCW), (-45, CW), (-135, CCW), (135, CW)),
    "quad-clockwise": _ring((45, CCW), (135, CW), (-135, CCW), (-45, CW)),
    "quad-plus": _ring((90, CCW), (-90, CCW), (0, CW), (180, CW)),
    "hexa-x": _ring((90, CW), (-90, CCW), (-30, CW), (150, CCW), (30, CCW), (-150, CW)),
    "hexa-plus": _ring((0, CW), (180, CCW), (-120, CW), (60, CCW), (-60, CCW), (120, CW)),
    "octo-x": _ring(
        (22.5, CW), (-157.5, CW), (67.5, CCW), (157.5, CCW), (-22.5, CCW), (-112.5, CCW), (-67.5, CW), (112.5, CW)
    ),
    "octo-plus": _ring((0, CW), (180, CW), (45, CCW), (135, CCW), (-45, CCW), (-135, CCW), (-90, CW), (90, CW)),
    "y6": _ring((60, CCW), (-60, CW), (-60, CCW), (180, CW), (60, CW), (180, CCW)),
    "y6b": _ring((60, CW), (60, CCW), (180, CW), (180, CCW), (-60, CW), (-60, CCW)),
    "octaquad-x": _ring((45, CCW), (-45, CW), (-135, CCW), (135, CW), (-45, CCW), (45, CW), (135, CCW), (-135, CW)),
}
"""Motor 1 first. Two motors in one place are one coaxial fan (``octaquad-x``, also called X8)."""

_ARDUPILOT = {
    (1, 0): "quad-plus", (1, 1): "quad-x", (1, 3): "quad-h", (1, 12): "quad-bf", (1, 13): "quad-dji",
    (1, 14): "quad-clockwise", (1, 18): "quad-bf-reversed", (2, 0): "hexa-plus", (2, 1): "hexa-x", (3, 0): "octo-plus",
    (3, 1): "octo-x", (4, 1): "octaquad-x", (5, 0): "y6", (5, 1): "y6", (5, 10): "y6b",
}  # fmt: skip
"""(FRAME_CLASS, FRAME_TYPE)."""


def ardupilot_frame(parameters: Mapping[str, float]) -> str | None:
    """The name of the frame that FRAME_CLASS and FRAME_TYPE say, or None where it is not in ``FRAMES``."""
    return _ARDUPILOT.get((int(parameters.get("FRAME_CLASS", 0)), int(parameters.get("FRAME_TYPE", -1))))


def px4_motors(parameters: Mapping[str, float]) -> tuple[tuple[Motor, ...], float] | None:
    """Motors of CA_ROTORn_*, places over the longest arm, and that arm's length [m]; None where PX4 says nothing."""
    count = int(parameters.get("CA_ROTOR_COUNT", 0))
    places = [tuple(parameters.get(f"CA_ROTOR{k}_P{axis}", 0.0) for axis in "XYZ") for k in range(count)]
    arm = max((math.hypot(x, y) for x, y, _ in places), default=0.0)
    if arm <= 0.0:
        return None
    spins = [CCW if parameters.get(f"CA_ROTOR{k}_KM", 0.05) > 0.0 else CW for k in range(count)]
    motors = tuple(
        Motor(k, x / arm, y / arm, spin, z / arm)
        for k, ((x, y, z), spin) in enumerate(zip(places, spins, strict=True), 1)
    )
    return motors, arm
