"""One simulated flight: body, sensors and autopilot on one clock."""

from __future__ import annotations

import math
from itertools import chain

from companion.sim.air import SurfaceLaw
from companion.sim.autopilot import Autopilot
from companion.sim.body import Body
from companion.sim.scenario import Scenario, ScriptPoint
from companion.sim.sensors import EscTelemetry, Estimate, Estimator, RangeSensor, ring_beams
from companion.sim.world import law_of
from models.common.frames import GRAVITY
from models.vehicle import Vehicle

HOVER_PARAM_SHARE = 0.89
"""MOT_THST_HOVER over the true hover throttle: as far off as it was found on the real autopilot."""


class SimulatedFlight:
    """Steps everything by ``DT``; the link and the pilot only talk to what is here."""

    def __init__(
        self,
        vehicle: Vehicle,
        scenario: Scenario,
        seed: int,
        *,
        autopilot: type[Autopilot] = Autopilot,
        estimator: type[Estimator] = Estimator,
        law: SurfaceLaw | None = None,
    ) -> None:
        self.vehicle = vehicle
        self.scenario = scenario
        self.seed = seed
        air = law or law_of(scenario.name, seed)
        self.body = Body(
            vehicle=vehicle,
            surroundings=scenario.surroundings,
            law=air,
            seed=seed,
            motor=autopilot.motor,
        )
        self.estimator = estimator(self.body, seed)
        self.autopilot = autopilot(vehicle, HOVER_PARAM_SHARE * vehicle.hover_thrust)
        named = [(r, f"range {seed} {i}") for i, r in enumerate(vehicle.rangefinders)]
        self.ranges = [RangeSensor(r, name) for r, name in named if not r.ring]
        self.rings = [ring_beams(r, name) for r, name in named if r.ring]
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
        if math.isfinite(self.script_began_s):
            return self.time_s - self.script_began_s
        return -1.0

    @property
    def reference(self) -> ScriptPoint:
        """Where the vehicle is to be now: the line of which the pilot sends single points."""
        return self.scenario.reference(self.script_s)

    def step(self) -> None:
        """One physics step, sensors and control included."""
        body = self.body
        self.estimate = self.estimator.step()
        body.step(self.autopilot.step(self.estimate, body.contact, body.time_s))
        for sensor in chain(self.ranges, *self.rings):
            sensor.step(body)
        self.esc.step(body)

    def needed_tilt(self) -> tuple[float, float]:
        """Roll and pitch [rad] that balance the true air at this instant, on the reference's straight line.

        The side force of ground and wall, the momentum drag at the reference velocity, and the side force of the vanes
        that hold the moments of both: the tilt of a pilot who knows everything.
        """
        body = self.body
        c = self.body.causes
        yaw = body.euler()[2]
        vn, ve, _ = self.reference.velocity
        ahead = math.cos(yaw) * vn + math.sin(yaw) * ve
        right = -math.sin(yaw) * vn + math.cos(yaw) * ve
        drag, arm = body.hover_drag()
        fx = c.corner[0] - drag * ahead
        fy = c.corner[1] - drag * right
        roll_moment = c.corner[3] - arm * drag * right
        for vane in self.vehicle.vanes[:1]:
            if abs(vane.axis[1]) > 0.5 and vane.position_m[2]:
                fy += roll_moment / vane.position_m[2]
        weight = self.vehicle.mass_kg * GRAVITY
        return -math.atan(fy / weight), math.atan(fx / weight)
