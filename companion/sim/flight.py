"""One simulated flight: body, sensors and autopilot on one clock, and the record of what truly happened."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TextIO

from companion.sim.air import SurfaceLaw
from companion.sim.autopilot import Autopilot
from companion.sim.body import ARDUPILOT_MOTOR, DT, GRAVITY, PX4_MOTOR, Body
from companion.sim.px4 import Px4
from companion.sim.scenario import Reference, Scenario
from companion.sim.sensors import EscTelemetry, Estimate, Estimator, RangeSensor
from companion.sim.world import law_of
from models.errors import ConfigError
from models.vehicle import Vehicle

HOVER_PARAM_SHARE = 0.89
"""MOT_THST_HOVER over the true hover throttle: as far off as it was found on the real autopilot."""


class Flight:
    """Steps everything by ``DT``; the link and the pilot only talk to what is here.

    ``parameters`` are the pilot's own settings of the autopilot, over its defaults.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        scenario: Scenario,
        seed: int,
        *,
        px4: bool = False,
        law: SurfaceLaw | None = None,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        self.vehicle = vehicle
        self.scenario = scenario
        self.seed = seed
        self.px4 = px4
        motor = PX4_MOTOR if px4 else ARDUPILOT_MOTOR
        self.body = Body(vehicle, scenario.surroundings, law or law_of(scenario.name, seed), seed, motor=motor)
        self.estimator = Estimator(self.body, seed)
        hover = HOVER_PARAM_SHARE * vehicle.hover_thrust
        self.autopilot = Px4(vehicle, hover) if px4 else Autopilot(vehicle, hover)
        for name, value in (parameters or {}).items():
            if not self.autopilot.set_parameter(name, value):
                raise ConfigError(f"simulated autopilot: no parameter '{name}'")
        self.ranges = [RangeSensor(r, f"range {seed} {i}") for i, r in enumerate(vehicle.rangefinders)]
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


WRENCH = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
COLUMNS = (
    "time_s",
    "script_s",
    "phase",
    "ref_n",
    "ref_e",
    "ref_d",
    "ref_vn",
    "ref_ve",
    "ref_vd",
    "n",
    "e",
    "d",
    "vn",
    "ve",
    "vd",
    "roll",
    "pitch",
    "yaw",
    "p",
    "q",
    "r",
    "est_n",
    "est_e",
    "est_d",
    "target_roll",
    "target_pitch",
    "command_roll",
    "command_pitch",
    "need_roll",
    "need_pitch",
    "throttle",
    "hand",
    *(f"{cause}_{axis}" for cause in ("free", "corner", "unsteady", "drag", "vanes", "contact") for axis in WRENCH),
    "contact",
    "height_m",
    "gap_m",
    "voltage_v",
    "current_a",
)


class TruthFile:
    """The truth as CSV at 50 Hz: SI, radians, world NED, wrenches by cause about the CG in body FRD.

    ``need_*`` is the tilt that balances the true air, ``command_*`` the last attitude command taken (its own position
    controller's where the autopilot flies), ``hand`` who flies, ``gap_m`` lip to wall.
    """

    def __init__(self, path: Path, flight: Flight) -> None:
        try:
            self._file: TextIO = path.open("w", encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"--truth {path}: cannot be written ({error.strerror})") from None
        self._flight = flight
        rotors = [f"rpm_{i + 1}" for i in range(len(flight.body.rpm))]
        self._file.write(",".join((*COLUMNS, *rotors)) + "\n")
        self._next_s = 0.0

    def step(self) -> None:
        """Write a row when due."""
        f = self._flight
        if f.time_s + 0.5 * DT < self._next_s:
            return
        self._next_s = round(f.time_s + 0.02, 4)
        b, a, c, reference = f.body, f.autopilot, f.body.causes, f.reference
        reach = f.scenario.surroundings.wall_m
        values = (
            *reference.position,
            *reference.velocity,
            *b.position,
            *b.velocity,
            *b.euler(),
            *b.rates,
            *f.estimate.position,
            a.shaped[0],
            a.shaped[1],
            *a.command,
            *f.needed_tilt(),
            a.throttle,
        )
        causes = (*c.free, *c.corner, *c.unsteady, *c.drag, *c.vanes, *c.contact)
        gap = b.wall_gap_m - b.lip_reach_m if math.isfinite(reach) else math.inf
        tail = (float(b.contact), -b.position[2], gap, b.pack.voltage_v, b.pack.current_a, *b.rpm)
        self._file.write(
            f"{f.time_s:.4f},{f.script_s:.4f},{reference.phase},"
            + ",".join(f"{v:.6g}" for v in values)
            + f",{a.hand},"
            + ",".join(f"{v:.6g}" for v in (*causes, *tail))
            + "\n"
        )

    def close(self) -> None:
        """Flush and close."""
        self._file.close()
