"""One thing that goes wrong, flown in lockstep: a pilot who follows a short script, and a judge who knows the truth.

A script is a generator: it acts, and yields the seconds until it acts again. It speaks real messages, as an operator
with sticks and a ground station does, and does to the companion's process what a bad computer does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from lockstep_faults import FaultyLockstep
from px4 import Px4
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simulated import is_px4, simulated

from companion.config import PipelineConfig
from companion.sim.autopilot import Mode
from companion.sim.body import Surroundings
from companion.sim.fan_wrench import Vec
from companion.sim.flight import SimulatedFlight
from companion.sim.link import COMPANION, SYSTEM
from companion.sim.scenario import Scenario, Waypoint, lip_reach, wall_azimuth
from models.common.errors import LinkError
from models.vehicle import Vehicle

POSITION_ONLY = 0x38 | 0x1C0 | 0x400 | 0x800
VELOCITY_ONLY = 0x7 | 0x1C0 | 0x400 | 0x800
"""type_mask of SET_POSITION_TARGET_LOCAL_NED: everything else is ignored."""
TARGET_PERIOD_S = 0.1
STICK_PERIOD_S = 0.05
"""Targets at 10 Hz and sticks at 20 Hz, as ground stations and radios send them."""
TAKE_OFF_LIMIT_S = 20.0
"""A take-off that is not over by then is given up."""
END_S = 600.0
"""A script that has not ended by then is ended (simulated time)."""
WIRE_S = 0.010
"""Delay each way: with it an attitude answers its setpoint as late as in the recordings of both real firmwares."""

Script = Callable[["CasePilot"], Iterator[float]]


@dataclass
class Judgement:
    """What truly happened from the moment of judging on. Lengths in metres, angles in degrees."""

    height_loss_m: float = 0.0
    """Furthest below the height at which the vehicle was, or was sent to."""
    rise_m: float = 0.0
    """Furthest above it."""
    off_m: float = 0.0
    """Furthest from that place, level."""
    tilt_deg: float = 0.0
    speed_m_s: float = 0.0
    ground_s: float = 0.0
    """Contact with the ground."""
    wall_s: float = 0.0
    engaged_s: float = 0.0
    """Time flown by the companion's attitude stream."""
    lowest_m: float = math.inf
    """Least height of the feet over the ground."""

    @property
    def contact_s(self) -> float:
        """Contact with anything."""
        return self.ground_s + self.wall_s


@dataclass(frozen=True)
class Case:
    """A vehicle, its settings, what is around it, and a script."""

    name: str
    what: str
    script: Script
    px4: bool = False
    parameters: Mapping[str, float] = field(default_factory=dict)
    true_hover: float | None = None
    """Command that truly hovers, where the vehicle file says another."""
    wall_m: float = math.inf
    """From the vehicle's foremost lip at its origin to the wall."""
    offsets: bool = True


class CasePilot:
    """Flies a script; ``judge`` starts the judgement."""

    def __init__(self, world: FaultyLockstep, script: Script) -> None:
        self.world = world
        self.flight: SimulatedFlight = world.flight
        self.over = False
        self.judgement = Judgement()
        self.notes: list[str] = []
        self._script = script(self)
        world.wire.down_delay_s = world.wire.up_delay_s = WIRE_S
        self._next_s = 0.0
        self._heartbeat_s = self._target_s = self._stick_s = 0.0
        self._sticks: tuple[float, float, float] | None = None
        self._target: Callable[[], Any] | None = None
        self._place: Vec | None = None
        self.judging = False

    # -- what a script may do ---------------------------------------------------------------------------------------

    def take_off(self, height_m: float) -> Iterator[float]:
        """Arm, take off and settle; the companion, where it runs, may have taken over."""
        if not is_px4(self.flight):
            self.mode(Mode.GUIDED)
        else:
            self.sticks()  # a radio is on
        self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        yield 0.5
        self._command(mavlink.MAV_CMD_NAV_TAKEOFF, p7=height_m)
        start = self.flight.time_s
        while (
            abs(-self.flight.body.position[2] - height_m) > 0.15
            and self.flight.time_s < start + TAKE_OFF_LIMIT_S
        ):
            yield 0.1
        yield 2.0

    def hand_over(self) -> Iterator[float]:
        """Let the companion fly: OFFBOARD on PX4 once its stream runs, GUIDED on ArduPilot; wait until it flies."""
        start = self.flight.time_s
        while self.flight.time_s < start + 8.0:
            pilot = self.flight.autopilot
            if pilot.mode is not Mode.GUIDED and (not isinstance(pilot, Px4) or pilot.stream_runs):
                self.mode(Mode.GUIDED)
            if self.flown_by_companion:
                break
            yield 0.1
        if not self.flown_by_companion:
            self.notes.append("the companion did not engage")
        yield 2.0

    def until_phase(self, share: float) -> Iterator[float]:
        """Wait until this share of a second after a heartbeat of the autopilot."""
        yield (share - self.flight.time_s) % 1.0

    def mode(self, mode: Mode) -> None:
        """Ask for a mode."""
        self._command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, *self.world.link.mode_numbers(mode))

    def sticks(self, forward: float = 0.0, right: float = 0.0, up: float = 0.0) -> None:
        """Hold the sticks so that the autopilot's Position or Loiter flies these velocities [m/s]."""
        self._sticks = (forward, right, up)

    def go(self, north: float, east: float, height: float) -> None:
        """Send the companion a place, again and again, until another target is given."""
        self._place = (north, east, -height)
        self._target = lambda: self._position(
            mavlink.MAV_FRAME_LOCAL_NED, POSITION_ONLY, north, east, -height
        )

    def move(self, north: float, east: float, down: float) -> None:
        """Send the companion a velocity, again and again."""
        self._target = lambda: self._position(
            mavlink.MAV_FRAME_LOCAL_NED, VELOCITY_ONLY, v=(north, east, down)
        )

    def once(self, frame: int, x: float, y: float, z: float) -> None:
        """Send the companion one place in a frame of MAVLink's."""
        self.world.link.route(self._position(frame, POSITION_ONLY, x, y, z))

    def silent(self) -> None:
        """No more targets."""
        self._target = None

    def judge(self, *, north: float = 0.0, east: float = 0.0, up: float = 0.0) -> None:
        """Judge from here on, against the present true place plus this."""
        n, e, d = self.flight.body.position
        self._place = (n + north, e + east, d - up)
        self.judgement = Judgement()
        self.judging = True

    @property
    def flown_by_companion(self) -> bool:
        """An attitude stream reaches the autopilot and is obeyed."""
        return (
            self.flight.autopilot.hand == "stream"
            and self.flight.time_s - self.world.link.attitude_stream_s < 0.3
        )

    # -- each step --------------------------------------------------------------------------------------------------

    def step(self) -> None:
        """Act when due; judge always."""
        now = self.flight.time_s
        if now >= self._heartbeat_s:
            self._heartbeat_s += 1.0
            self.world.link.route(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        if self._sticks is not None and now >= self._stick_s:
            self._stick_s = now + STICK_PERIOD_S
            self._push_sticks(*self._sticks)
        if self._target is not None and now >= self._target_s:
            self._target_s = now + TARGET_PERIOD_S
            self.world.link.route(self._target())
        if now >= self._next_s and not self.over:
            wait = next(self._script, None)
            self.over = wait is None or now > END_S
            self._next_s = now + (wait or 0.0)
        if self.judging and self._place is not None:
            self._watch(self._place)

    def _watch(self, place: Vec) -> None:
        b, j = self.flight.body, self.judgement
        n, e, d = b.position
        roll, pitch, _ = b.euler()
        j.height_loss_m = max(j.height_loss_m, d - place[2])
        j.rise_m = max(j.rise_m, place[2] - d)
        j.off_m = max(j.off_m, math.hypot(n - place[0], e - place[1]))
        j.tilt_deg = max(
            j.tilt_deg,
            math.degrees(math.acos(max(-1.0, min(1.0, math.cos(roll) * math.cos(pitch))))),
        )
        j.speed_m_s = max(j.speed_m_s, math.hypot(*b.velocity))
        j.wall_s += b.dt * b.wall_contact
        j.ground_s += b.dt * (b.contact and not b.wall_contact)
        j.engaged_s += b.dt * self.flown_by_companion
        j.lowest_m = min(j.lowest_m, b.clearance_m)

    def _push_sticks(self, forward: float, right: float, up: float) -> None:
        pilot = self.flight.autopilot
        top = pilot.stick_speed_m_s
        z = 500.0 + 500.0 * max(-1.0, min(1.0, up / pilot.speed_up_m_s))
        self._to_autopilot(
            mavlink.MAVLink_manual_control_message(
                SYSTEM, round(1000.0 * forward / top), round(1000.0 * right / top), round(z), 0, 0
            )
        )

    def _position(
        self,
        frame: int,
        mask: int,
        x: float = 0.0,
        y: float = 0.0,
        z: float = 0.0,
        v: Vec = (0.0, 0.0, 0.0),
    ) -> Any:
        return mavlink.MAVLink_set_position_target_local_ned_message(
            self.world.link.boot_ms,
            SYSTEM,
            COMPANION,
            frame,
            mask,
            x,
            y,
            z,
            *v,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
        )

    def _command(
        self, number: int, p1: float = 0.0, p2: float = 0.0, p3: float = 0.0, p7: float = 0.0
    ) -> None:
        self._to_autopilot(
            mavlink.MAVLink_command_long_message(
                SYSTEM, 1, number, 0, p1, p2, p3, 0.0, 0.0, 0.0, p7
            )
        )

    def _to_autopilot(self, message: Any) -> None:
        self.world.link.hear(message)


def surroundings(case: Case, vehicle: Vehicle) -> Scenario:
    """An empty script in the surroundings of a case: the wall where the vehicle's wall sensor looks."""
    azimuth = wall_azimuth(vehicle)
    around = Surroundings(
        wall_m=case.wall_m + lip_reach(vehicle, azimuth), wall_azimuth_rad=azimuth
    )
    return Scenario(
        case.name,
        around,
        (Waypoint(0.0, 0.0, 1.2, name="case"), Waypoint(1.0, 0.0, 1.2, name="end")),
    )


@dataclass(frozen=True)
class Outcome:
    """A case, flown."""

    case: str
    judgement: Judgement
    notes: tuple[str, ...]
    reasons: Mapping[str, float]
    """Refusals of the companion that ran last, with their seconds."""

    def as_json(self) -> dict[str, Any]:
        """Plain numbers, rounded to what is worth reading."""
        numbers = {k: round(v, 3) for k, v in asdict(self.judgement).items()}
        return {
            "case": self.case,
            **numbers,
            "notes": list(self.notes),
            "refusals_s": dict(self.reasons),
        }


def fly_case(
    case: Case,
    vehicle: Vehicle,
    config: PipelineConfig,
    seed: int = 1,
    *,
    truth: Path | None = None,
    record: Path | None = None,
) -> Outcome:
    """Fly one case with the flight program as ``config`` says; the same seed gives the same outcome.

    Raises LinkError where the script never came to be judged.
    """
    true = vehicle if case.true_hover is None else replace(vehicle, hover_thrust=case.true_hover)
    flight = simulated(
        true, surroundings(case, true), seed, px4=case.px4, parameters=case.parameters
    )
    pilots: list[CasePilot] = []

    def pilot(world: FaultyLockstep) -> CasePilot:
        pilots.append(CasePilot(world, case.script))
        return pilots[0]

    world = FaultyLockstep(flight, pilot, truth)
    world.fly(replace(config, vehicle=vehicle, offsets=config.offsets and case.offsets), record)
    if not pilots[0].judging:
        raise LinkError(f"case '{case.name}': its script ended before anything was judged")
    reasons = {} if world.companion is None else world.companion.summary.as_json()["refusals_s"]
    return Outcome(case.name, pilots[0].judgement, tuple(pilots[0].notes), reasons)
