"""One simulated flight: body, sensors and autopilot on one clock, and the record of what truly happened."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TextIO

from companion.sim.air import SurfaceLaw
from companion.sim.autopilot import Autopilot
from companion.sim.body import ARDUPILOT_MOTOR, DT, PX4_MOTOR, Body
from companion.sim.px4 import Px4
from companion.sim.scenario import Reference, Scenario
from companion.sim.sensors import EscTelemetry, Estimate, Estimator, RangeSensor, RingSensor
from companion.sim.vision import VisionEstimator
from companion.sim.world import law_of
from models.errors import ConfigError
from models.frames import GRAVITY
from models.vehicle import Vehicle

HOVER_PARAM_SHARE = 0.89
"""MOT_THST_HOVER over the true hover throttle: as far off as it was found on the real autopilot."""


class Flight:
    """Steps everything by ``DT``; the link and the pilot only talk to what is here.

    ``parameters`` are the pilot's own settings of the autopilot, over its defaults. ``vision``: no GPS.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        scenario: Scenario,
        seed: int,
        *,
        px4: bool = False,
        vision: bool = False,
        law: SurfaceLaw | None = None,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        self.vehicle = vehicle
        self.scenario = scenario
        self.seed = seed
        self.px4 = px4
        motor = PX4_MOTOR if px4 else ARDUPILOT_MOTOR
        self.body = Body(vehicle, scenario.surroundings, law or law_of(scenario.name, seed), seed, motor=motor)
        self.estimator = VisionEstimator(self.body, seed) if vision else Estimator(self.body, seed)
        hover = HOVER_PARAM_SHARE * vehicle.hover_thrust
        self.autopilot = Px4(vehicle, hover) if px4 else Autopilot(vehicle, hover)
        for name, value in (parameters or {}).items():
            if not self.autopilot.set_parameter(name, value):
                raise ConfigError(f"simulated autopilot: no parameter '{name}'")
        named = [(r, f"range {seed} {i}") for i, r in enumerate(vehicle.rangefinders)]
        self.ranges = [RangeSensor(r, name) for r, name in named if not r.ring]
        self.rings = [RingSensor(r, name) for r, name in named if r.ring]
        self.esc = EscTelemetry(self.body, seed)
        self.estimate: Estimate = self.estimator.step()
        self.script_began_s = math.inf
        """Boot time at which the pilot began its script."""

    @property
    def time_s(self) -> float:
        """Seconds since boot."""
        return self.body.time_s

    @property
    def script_s(self) -> float:
        """Time of the script; -1 before it begins."""
        return self.time_s - self.script_began_s if math.isfinite(self.script_began_s) else -1.0

    @property
    def reference(self) -> Reference:
        """Where the vehicle is to be now: the line of which the pilot sends single points."""
        return self.scenario.reference(self.script_s)

    def step(self) -> None:
        """One physics step, sensors and control included."""
        body = self.body
        self.estimate = self.estimator.step()
        self.autopilot.position_trusted = self.estimator.trusted
        pwm = self.autopilot.step(self.estimate, body.contact, body.time_s)
        body.step(pwm)
        for sensor in self.ranges:
            sensor.step(body)
        for ring in self.rings:
            ring.step(body)
        self.esc.step(body)

    def needed_tilt(self) -> tuple[float, float]:
        """Roll and pitch [rad] that balance the true air at this instant, on the reference's straight line.

        The side force of ground and wall, the momentum drag at the reference velocity, and the side force of the vanes
        that hold the moments of both: the tilt of a pilot who knows everything.
        """
        body, c = self.body, self.body.causes
        yaw = body.euler()[2]
        vn, ve, _ = self.reference.velocity
        ahead, right = math.cos(yaw) * vn + math.sin(yaw) * ve, -math.sin(yaw) * vn + math.cos(yaw) * ve
        drag, arm = body.drag_per_speed(), body.drag_arm_m
        fx, fy = c.corner[0] - drag * ahead, c.corner[1] - drag * right
        roll_moment = c.corner[3] - arm * drag * right
        for vane in self.vehicle.vanes[:1]:
            if abs(vane.axis[1]) > 0.5 and vane.position_m[2]:
                fy += roll_moment / vane.position_m[2]
        weight = self.vehicle.mass_kg * GRAVITY
        return -math.atan(fy / weight), math.atan(fx / weight)


_AXES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")


class TruthFile:
    """The truth as CSV at 50 Hz: SI, radians, world NED, wrenches by cause about the CG in body FRD.

    ``need_*`` is the tilt that balances the true air, ``command_*`` the last attitude command taken (its own position
    controller's where the autopilot flies), ``hand`` who flies, ``gap_m`` lip to wall.
    """

    def __init__(self, path: Path, flight: Flight) -> None:
        self._flight = flight
        try:
            self._file: TextIO = path.open("w", encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"--truth {path}: cannot be written ({error.strerror})") from None
        self._file.write(",".join(self._row()) + "\n")
        self._next_s = 0.0

    def step(self) -> None:
        """Write a row when due."""
        now_s = self._flight.time_s
        if now_s + 0.5 * DT < self._next_s:
            return
        self._next_s = round(now_s + 0.02, 4)
        self._file.write(",".join(self._row().values()) + "\n")

    def _row(self) -> dict[str, str]:
        """The present numbers by the names of their columns."""
        f = self._flight
        b, a, reference = f.body, f.autopilot, f.reference
        gap = b.wall_gap_m - b.lip_reach_m if math.isfinite(f.scenario.surroundings.wall_m) else math.inf
        row = {"time_s": f"{f.time_s:.4f}", "script_s": f"{f.script_s:.4f}", "phase": reference.phase}
        row |= _named("ref_n ref_e ref_d", reference.position)
        row |= _named("ref_vn ref_ve ref_vd", reference.velocity)
        row |= _named("n e d", b.position)
        row |= _named("vn ve vd", b.velocity)
        row |= _named("roll pitch yaw", b.euler())
        row |= _named("p q r", b.rates)
        row |= _named("est_n est_e est_d", f.estimate.position)
        row |= _named("target_roll target_pitch", a.shaped[:2])
        row |= _named("command_roll command_pitch", a.command)
        row |= _named("need_roll need_pitch", f.needed_tilt())
        row |= _named("throttle", [a.throttle])
        row["hand"] = a.hand
        for cause, wrench in vars(b.causes).items():
            row |= _named(" ".join(f"{cause}_{axis}" for axis in _AXES), wrench)
        row |= _named("contact height_m gap_m", (float(b.contact), -b.position[2], gap))
        row |= _named("voltage_v current_a", (b.pack.voltage_v, b.pack.current_a))
        return row | _named(" ".join(f"rpm_{i + 1}" for i in range(len(b.rpm))), b.rpm)

    def close(self) -> None:
        """Flush and close."""
        self._file.close()


def _named(names: str, values: Sequence[float]) -> dict[str, str]:
    return {name: f"{value:.6g}" for name, value in zip(names.split(), values, strict=True)}
