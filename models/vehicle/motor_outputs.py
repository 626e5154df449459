"""Which outputs drive the motors, by the parameters of ArduPilot and PX4.

Sources: ArduPilot SERVOn_FUNCTION (k_motor1 = 33 and on); PX4 output functions (Motor 1 = 101 and on), one parameter an
output and driver (PWM_MAIN_FUNCn, PWM_AUX_FUNCn, UAVCAN_EC_FUNCn ...).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

PORT_OUTPUTS = 16
"""Outputs that one SERVO_OUTPUT_RAW carries."""
_ARDUPILOT_MOTORS = (*range(33, 41), *range(82, 86), *range(160, 180))
"""SERVOn_FUNCTION of motors 1 to 32."""
_PX4_MOTORS = tuple(range(101, 113))
"""Output functions of motors 1 to 12."""
_ARDUPILOT_OUTPUTS = 32
MAIN = "MAIN"
AUX = "AUX"
CAN = "CAN"
_PX4_DRIVERS = (
    (MAIN, "PWM_MAIN_FUNC{}", 0),
    (AUX, "PWM_AUX_FUNC{}", 1),
    (CAN, "UAVCAN_EC_FUNC{}", None),
    ("HIL", "HIL_ACT_FUNC{}", None),
    ("Gazebo", "SIM_GZ_EC_FUNC{}", None),
    ("I2C", "PCA9685_FUNC{}", None),
    ("serial", "VOXL_ESC_FUNC{}", None),
    ("serial IO", "VOXL2_IO_FUNC{}", None),
)
"""Name, parameter, and the port where its outputs are sent on a board that has MAIN and AUX; None where that depends on
which driver started first."""


@dataclass(frozen=True)
class DeclaredMotors:
    """The motors that the parameters put on the outputs of one driver."""

    group: str
    """``MAIN``, ``AUX``, ``CAN`` ... of PX4; empty on ArduPilot."""
    port: int | None
    """SERVO_OUTPUT_RAW.port of these outputs, where that is fixed."""
    numbers: Mapping[int, int]
    """Motor number to output of the port, both from 1."""
    parameter: str
    """One of the parameters that say it."""


def declared_motors(parameters: Mapping[str, float]) -> list[DeclaredMotors]:
    """Every driver that the parameters give a motor, those with most motors first; none where no parameter says it."""
    found = [*_ardupilot(parameters), *_px4(parameters)]
    return sorted(found, key=lambda one: -len(one.numbers))


def _ardupilot(parameters: Mapping[str, float]) -> list[DeclaredMotors]:
    out = []
    for port in range(_ARDUPILOT_OUTPUTS // PORT_OUTPUTS):
        first = port * PORT_OUTPUTS
        numbers = _numbers(parameters, "SERVO{}_FUNCTION", _ARDUPILOT_MOTORS, first)
        if numbers:
            output = first + min(numbers.values())
            out.append(DeclaredMotors("", port, numbers, f"SERVO{output}_FUNCTION"))
    return out


def _px4(parameters: Mapping[str, float]) -> list[DeclaredMotors]:
    out = []
    for group, pattern, port in _PX4_DRIVERS:
        numbers = _numbers(parameters, pattern, _PX4_MOTORS, 0)
        if numbers:
            parameter = pattern.format(min(numbers.values()))
            out.append(DeclaredMotors(group, port, numbers, parameter))
    return out


def _numbers(
    parameters: Mapping[str, float], pattern: str, motors: tuple[int, ...], first: int
) -> dict[int, int]:
    """Motor to output, of the ``PORT_OUTPUTS`` outputs behind ``first``."""
    out = {}
    for output in range(1, PORT_OUTPUTS + 1):
        function = int(parameters.get(pattern.format(first + output), -1))
        if function in motors:
            out[motors.index(function) + 1] = output
    return out
