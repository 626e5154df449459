"""What a vehicle is: mass, fans, vanes, rangefinders and limits."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from models.common.frames import Array
from models.common.toml_table import Bounds, Options, above

NO_ORIENTATION = 255  # no MAV_SENSOR_ORIENTATION
MAV_ORIENTATION_UP = 24  # MAV_SENSOR_ROTATION_PITCH_90
TARGETS = ("ground", "wall", "ceiling", "none")
RHO_SEA_LEVEL = 1.225  # kg/m^3, ISO 2533
Vector3 = tuple[float, float, float]
ASSUMABLE = ("mass_kg", "rotor_radius_m", "position_m", "order")
_Place = Annotated[Vector3, Bounds(-100.0, 100.0)]
Problem = tuple[str, str]
"""A key, and what is wrong with it."""


@dataclass(frozen=True)
class Rotor:
    """One rotor of a fan. Exactly one of ``esc`` and ``servo`` is set; both count from 1."""

    spin: Annotated[int, Options({"cw": 1, "ccw": -1})]
    """+1 turns clockwise seen from above, -1 counter-clockwise."""
    esc: Annotated[int | None, Bounds(1, 32)] = None
    servo: Annotated[int | None, Bounds(1, 16)] = None

    def problem(self) -> Problem | None:
        """What is wrong with the values together."""
        if (self.esc is None) == (self.servo is None):
            return ("esc", "or 'servo' is needed, one of the two")
        return None


@dataclass(frozen=True)
class Fan:
    """One lifting unit: one surrogate query.

    ``position_m`` is the reference point (lower face of the upper hub, on the axis) from the CG, body FRD.
    ``ct`` and ``cq`` are the free-air coefficients T/(rho A Omega^2 R^2) and Q/(rho A Omega^2 R^3) of the unit.
    """

    position_m: _Place
    lip_radius_m: Annotated[float, above(0.0, 10.0)]
    rotors: tuple[Rotor, ...]
    ct: Annotated[float | None, above(0.0, 1.0)] = None
    cq: Annotated[float | None, above(0.0, 1.0)] = None


@dataclass(frozen=True, kw_only=True)
class Vane:
    """A control vane in a fan's exhaust; its force is ``force_per_thrust_rad`` x deflection x the fan's lift."""

    servo: Annotated[int, Bounds(1, 16)]
    fan: int
    position_m: _Place
    axis: Annotated[Vector3, Bounds(-1.0, 1.0)]
    force_per_thrust_rad: Annotated[float, Bounds(0.0, 10.0)]
    neutral_us: Annotated[float, Bounds(500.0, 2500.0)]
    rad_per_us: Annotated[float, Bounds(-0.1, 0.1)]

    def problem(self) -> Problem | None:
        """What is wrong with the values together."""
        if abs(math.hypot(*self.axis) - 1.0) > 1e-3:
            return ("axis", "must be a direction of length 1")
        return None


@dataclass(frozen=True, kw_only=True)
class Throttle:
    """Thrust of a rotor from its servo output, where no rotor speed is telemetered.

    thrust = max_thrust_n * ((1 - expo) u + expo u^2), u = (pwm - min)/(max - min), at ``voltage_v``. Outputs are taken
    as the autopilot sends them: pulses in us, DShot of PX4 0 to 1999, CAN 0 to 8191.
    """

    max_thrust_n: Annotated[float, above(0.0, 1e5)]
    expo: Annotated[float, Bounds(-1.0, 1.0)]
    pwm_min_us: Annotated[float, Bounds(0.0, 10_000.0)]
    pwm_max_us: Annotated[float, Bounds(0.0, 10_000.0)]
    voltage_v: Annotated[float, above(0.0, 1000.0)]
    port: Annotated[int, Bounds(0, 7)] = 0
    """SERVO_OUTPUT_RAW.port that the rotors' ``servo`` counts on: 1 for PX4's AUX outputs beside an IO chip."""

    def problem(self) -> Problem | None:
        """What is wrong with the values together."""
        if self.pwm_max_us <= self.pwm_min_us:
            return ("pwm_max_us", "must be above pwm_min_us")
        return None


@dataclass(frozen=True)
class Rangefinder:
    """A range sensor: ``orientation`` as sent on the wire, what it looks at, and where it sits (body FRD).

    ``ring``: a ring of so many directions around the vehicle (OBSTACLE_DISTANCE), which has no orientation.
    """

    REQUIRED: ClassVar = ("target", "position_m")
    """Of a file."""
    orientation: Annotated[int, Bounds(0, 255)] = NO_ORIENTATION
    target: Annotated[str, Options({target: target for target in TARGETS})] = "none"
    position_m: _Place = (0.0, 0.0, 0.0)
    ring: Annotated[int, Bounds(4, 72)] = 0

    def problem(self) -> Problem | None:
        """What is wrong with the values together."""
        if not self.ring:
            if self.orientation == NO_ORIENTATION:
                return ("orientation", "is missing")
            return None
        if self.orientation != NO_ORIENTATION:
            return "orientation", "and 'ring' are both given: a ring looks all around"
        if self.target not in ("wall", "none"):
            return ("target", "of a ring must be 'wall' or 'none'")
        return None


@dataclass(frozen=True, kw_only=True)
class Limits:
    """How far and how fast an offset may go (``thrust`` is a share of full throttle), and how the hold may move.

    Speed, climb and acceleration are optional in the file: they bound the way to a target that is somewhere else.
    """

    REQUIRED: ClassVar = ("thrust", "tilt_deg", "slew_thrust_per_s", "slew_tilt_deg_per_s")
    """Of a file that has limits of its own."""
    thrust: Annotated[float, Bounds(0.0, 0.5)] = 0.10
    tilt_deg: Annotated[float, Bounds(0.0, 30.0)] = 8.0
    slew_thrust_per_s: Annotated[float, above(0.0, 100.0)] = 0.5
    slew_tilt_deg_per_s: Annotated[float, above(0.0, 3600.0)] = 60.0
    speed_m_s: Annotated[float, above(0.0, 20.0)] = 1.5
    climb_m_s: Annotated[float, above(0.0, 10.0)] = 1.0
    acceleration_m_s2: Annotated[float, above(0.0, 10.0)] = 2.0


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """Everything about the vehicle that the air does not decide. SI units, body FRD about the CG.

    Examples
    --------
    >>> from models.vehicle import load_vehicle
    >>> vehicle = load_vehicle("my.toml")
    >>> vehicle.fan_positions_m.shape, vehicle.telemetered
    ((4, 3), True)
    """

    name: str
    """In texts and pages."""
    mass_kg: Annotated[float, above(0.0, 1e4)]
    """At take-off, with battery and load."""
    inertia_kgm2: Annotated[Vector3, above(0.0, 1e4)]
    """Moments of inertia about the axes of the body."""
    hover_thrust: Annotated[float, above(0.0, 1.0)]
    """Share of full throttle at which it hovers."""
    rotor_radius_m: Annotated[float, above(0.0, 10.0)]
    """Of every rotor."""
    fans: tuple[Fan, ...]
    """Lifting units: one rotor, or two on one axis."""
    vanes: tuple[Vane, ...] = ()
    """Control vanes in the exhaust of fans."""
    throttle: Throttle | None = None
    """Thrust by outputs; None where the ESCs tell rotor speeds."""
    rangefinders: tuple[Rangefinder, ...] = ()
    """Range sensors, where they sit and look."""
    limits: Limits = field(default_factory=Limits)
    """How far and how fast an offset may go."""
    assumed: tuple[Annotated[str, Options({key: key for key in ASSUMABLE})], ...] = ()
    """Keys whose numbers are typical of such vehicles, not of this one. Without ``position_m`` no moment is judged."""

    @property
    def mass_assumed(self) -> bool:
        """Whether the mass is a typical one: forces are then known as shares of the weight only."""
        return "mass_kg" in self.assumed

    def problem(self) -> Problem | None:
        """What is wrong with the values together.

        Returns
        -------
        (str, str) or None
            A key, and what is wrong with it.
        """
        if 2.0 * max(self.inertia_kgm2) > sum(self.inertia_kgm2) * (1.0 + 1e-9):
            return (
                "inertia_kgm2",
                "is impossible: no body has one moment of inertia above the sum of the others",
            )
        for i, vane in enumerate(self.vanes, 1):
            if vane.fan > len(self.fans):
                return (
                    f"vane[{i}].fan",
                    f"must be a whole number from 1 to {len(self.fans)}, not {vane.fan}",
                )
        for i, fan in enumerate(self.fans, 1):
            if fan.lip_radius_m < self.rotor_radius_m - 1e-9:
                return (
                    f"fan[{i}].lip_radius_m",
                    "is smaller than rotor_radius_m; is that the diameter?",
                )
        return self._rotors_problem()

    def _rotors_problem(self) -> Problem | None:
        by_esc = [r.esc for r in self.rotors if r.esc is not None]
        by_servo = [r.servo for r in self.rotors if r.servo is not None]
        if by_esc and by_servo:
            return "fan", "mixes rotors named by 'esc' and by 'servo': use one of the two"
        if by_servo and self.throttle is None:
            return "throttle", "is missing, and the rotors are named by 'servo'"
        if by_esc and self.throttle is not None:
            return "throttle", "is given, but the rotors are named by 'esc'"
        for key, ids in (("esc", by_esc), ("servo", by_servo + [v.servo for v in self.vanes])):
            if len(set(ids)) != len(ids):
                return key, f"{max(ids, key=ids.count)} is used twice"
        return None

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        # Caches are keyed by the vehicle and asked at every message.
        return hash(
            (self.name, self.mass_kg, self.inertia_kgm2, self.fans, self.vanes, self.throttle)
        )

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
    def rotor_counts(self) -> Array:
        """Rotors of each fan, shape (fans,)."""
        return np.array([float(len(fan.rotors)) for fan in self.fans])

    @cached_property
    def fan_positions_m(self) -> Array:
        """Reference points from the CG, shape (fans, 3), body FRD."""
        return np.array([fan.position_m for fan in self.fans])

    @cached_property
    def lip_radii_m(self) -> Array:
        """Outer duct lips, shape (fans,)."""
        return np.array([fan.lip_radius_m for fan in self.fans])

    @property
    def disc_area_m2(self) -> float:
        """A = pi R^2 of one disc."""
        return math.pi * self.rotor_radius_m**2

    @property
    def servo_port(self) -> int:
        """SERVO_OUTPUT_RAW.port that the outputs of rotors and vanes count on."""
        if self.throttle is not None:
            return self.throttle.port
        return 0

    @property
    def telemetered(self) -> bool:
        """True where rotor speeds come from ESC telemetry, False where they follow from servo outputs."""
        return self.throttle is None

    @cached_property
    def watched(self) -> tuple[Rangefinder, ...]:
        """The declared rangefinders, and after them one that looks up from the CG where none is declared to.

        A ceiling is then known from an upward rangefinder that the vehicle file does not name. A ring stands twice:
        it sees up to two walls.
        """
        up = MAV_ORIENTATION_UP
        declared = tuple(r for r in self.rangefinders for _ in range(2 if r.ring else 1))
        if any(r.target == "ceiling" or r.orientation == up for r in declared):
            return declared
        return (*declared, Rangefinder(up, "ceiling", (0.0, 0.0, 0.0)))

    def rangefinders_for(self, target: str) -> tuple[Rangefinder, ...]:
        """The rangefinders that look at one kind of surface.

        Parameters
        ----------
        target : str
            As in the vehicle file: ``ground``, ``wall``, ``ceiling`` or ``none``.

        Returns
        -------
        tuple of Rangefinder
            In the order of the file.
        """
        return tuple(r for r in self.rangefinders if r.target == target)
