"""What a vehicle is: mass, fans, vanes, rangefinders and limits."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

MAV_ORIENTATION_UP = 24  # MAV_SENSOR_ROTATION_PITCH_90
TARGETS = ("ground", "wall", "ceiling", "none")
RHO_SEA_LEVEL = 1.225  # kg/m^3, ISO 2533
Vector3 = tuple[float, float, float]


@dataclass(frozen=True)
class Rotor:
    """One rotor of a fan. Exactly one of ``esc`` and ``servo`` is set; both count from 1."""

    spin: int
    """+1 turns clockwise seen from above, -1 counter-clockwise."""
    esc: int | None = None
    servo: int | None = None


@dataclass(frozen=True)
class Fan:
    """One lifting unit: one surrogate query.

    ``position_m`` is the reference point (lower face of the upper hub, on the axis) from the CG, body FRD.
    ``ct`` and ``cq`` are the free-air coefficients T/(rho A Omega^2 R^2) and Q/(rho A Omega^2 R^3) of the unit.
    """

    position_m: Vector3
    lip_radius_m: float
    rotors: tuple[Rotor, ...]
    ct: float | None = None
    cq: float | None = None


@dataclass(frozen=True)
class Vane:
    """A control vane in a fan's exhaust; its force is ``force_per_thrust_rad`` x deflection x the fan's lift."""

    servo: int
    fan: int
    position_m: Vector3
    axis: Vector3
    force_per_thrust_rad: float
    neutral_us: float
    rad_per_us: float


@dataclass(frozen=True)
class Throttle:
    """Thrust of a rotor from its servo output, where no rotor speed is telemetered.

    thrust = max_thrust_n * ((1 - expo) u + expo u^2), u = (pwm - min)/(max - min), at ``voltage_v``.
    """

    max_thrust_n: float
    expo: float
    pwm_min_us: float
    pwm_max_us: float
    voltage_v: float


@dataclass(frozen=True)
class Rangefinder:
    """A range sensor: ``orientation`` as sent on the wire, what it looks at, and where it sits (body FRD)."""

    orientation: int
    target: str
    position_m: Vector3


@dataclass(frozen=True)
class Limits:
    """How far and how fast an offset may go (``thrust`` is a share of full throttle), and how the hold may move.

    Speed, climb and acceleration are optional in the file: they bound the way to a target that is somewhere else.
    """

    thrust: float = 0.10
    tilt_deg: float = 8.0
    slew_thrust_per_s: float = 0.5
    slew_tilt_deg_per_s: float = 60.0
    speed_m_s: float = 1.5
    climb_m_s: float = 1.0
    acceleration_m_s2: float = 2.0


@dataclass(frozen=True)
class Vehicle:
    """Everything about the vehicle that the air does not decide. SI units, body FRD about the CG."""

    name: str
    mass_kg: float
    inertia_kgm2: Vector3
    hover_thrust: float
    rotor_radius_m: float
    fans: tuple[Fan, ...]
    vanes: tuple[Vane, ...] = ()
    throttle: Throttle | None = None
    rangefinders: tuple[Rangefinder, ...] = ()
    limits: Limits = field(default_factory=Limits)

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        # Caches are keyed by the vehicle and asked at every message.
        return hash((self.name, self.mass_kg, self.inertia_kgm2, self.fans, self.vanes, self.throttle))

    @cached_property
    def rotors(self) -> tuple[Rotor, ...]:
        """All rotors, fan by fan: the order of every ``rpm`` array with a rotor axis."""
        return tuple(rotor for fan in self.fans for rotor in fan.rotors)

    @cached_property
    def rotor_fan(self) -> tuple[int, ...]:
        """Index of the fan that each rotor of ``rotors`` belongs to."""
        return tuple(i for i, fan in enumerate(self.fans) for _ in fan.rotors)

    @cached_property
    def first_rotors(self) -> NDArray[np.intp]:
        """Where each fan's rotors begin in ``rotors``, shape (fans,)."""
        counts = [len(fan.rotors) for fan in self.fans]
        return np.cumsum([0, *counts[:-1]], dtype=np.intp)

    @cached_property
    def rotor_counts(self) -> NDArray[np.float64]:
        """Rotors of each fan, shape (fans,)."""
        return np.array([float(len(fan.rotors)) for fan in self.fans])

    @cached_property
    def fan_positions_m(self) -> NDArray[np.float64]:
        """Reference points from the CG, shape (fans, 3), body FRD."""
        return np.array([fan.position_m for fan in self.fans])

    @cached_property
    def lip_radii_m(self) -> NDArray[np.float64]:
        """Outer duct lips, shape (fans,)."""
        return np.array([fan.lip_radius_m for fan in self.fans])

    @property
    def disc_area_m2(self) -> float:
        """A = pi R^2 of one disc."""
        return math.pi * self.rotor_radius_m**2

    @property
    def telemetered(self) -> bool:
        """True where rotor speeds come from ESC telemetry, False where they follow from servo outputs."""
        return self.throttle is None

    @cached_property
    def watched(self) -> tuple[Rangefinder, ...]:
        """The declared rangefinders, and after them one that looks up from the CG where none is declared to.

        A ceiling is then known from an upward rangefinder that the vehicle file does not name.
        """
        up = MAV_ORIENTATION_UP
        if any(r.target == "ceiling" or r.orientation == up for r in self.rangefinders):
            return self.rangefinders
        return (*self.rangefinders, Rangefinder(up, "ceiling", (0.0, 0.0, 0.0)))

    def rangefinders_for(self, target: str) -> tuple[Rangefinder, ...]:
        """The rangefinders declared to look at ``target``."""
        return tuple(r for r in self.rangefinders if r.target == target)
