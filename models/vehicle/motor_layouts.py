"""Frames: where each motor sits and how it turns, by the motor numbers of ArduPilot and PX4 (motor_layouts.toml)."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

CW = 1
CCW = -1
_SPINS = {"cw": CW, "ccw": CCW}


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


def _motors(layout: Mapping[str, Any]) -> Frame:
    """The motors of one table of the file."""
    motors: Sequence[Motor]
    if "like" in layout:
        motors = FRAMES[layout["like"]]
    elif "ring" in layout:
        motors = [_on_ring(k, *motor) for k, motor in enumerate(layout["ring"], 1)]
    else:
        arm = max(math.hypot(x, y) for x, y, _ in layout["places"])
        motors = []
        for k, (x, y, spin) in enumerate(layout["places"], 1):
            motors.append(Motor(number=k, forward=x / arm, right=y / arm, spin=_SPINS[spin]))
    out = []
    for motor, number in zip(motors, layout.get("numbers", count(1)), strict=False):
        yaw = layout.get("yaw", motor.yaw)
        if motor.forward > 0.0:
            yaw = layout.get("front_yaw", yaw)
        spin = -motor.spin if layout.get("reversed") else motor.spin
        out.append(replace(motor, number=number, yaw=yaw, spin=spin))
    return tuple(out)


def _on_ring(number: int, angle_deg: float, spin: str) -> Motor:
    """A motor by its angle clockwise from the nose."""
    angle = math.radians(angle_deg)
    forward = round(math.cos(angle), 9)
    right = round(math.sin(angle), 9)
    return Motor(number=number, forward=forward, right=right, spin=_SPINS[spin])


LAYOUTS = tomllib.loads(Path(__file__).with_name("motor_layouts.toml").read_text("utf-8"))
"""The file, by name of the frame."""
FRAMES: dict[str, Frame] = {}
"""Motor 1 first."""
UNSURE: dict[str, str] = {}
"""Why places and spins do not say the moments of these frames."""
for _name, _layout in LAYOUTS.items():
    FRAMES[_name] = _motors(_layout)
    if "unsure" in _layout:
        UNSURE[_name] = _layout["unsure"]
