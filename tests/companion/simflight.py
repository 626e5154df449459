"""A simulated flight in the test's own process: hovering vehicles, messages to and from their link."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simulated import link_of, simulated

import companion
from companion.config import PipelineConfig
from companion.mavlink.setpoints import SET_ATTITUDE_TARGET, encode
from companion.mavlink.wire_frames import cut
from companion.sim.autopilot import Mode
from companion.sim.flight import SimulatedFlight
from companion.sim.scenario import build
from models.common.frames import quaternion_from_euler
from models.vehicle import Vehicle, load_vehicle
from replay.logs.tlog import read_tlog
from replay.rerun.harness import Replay

VEHICLES = Path(companion.__file__).parent / "vehicles"
HEIGHT_M = 1.5


@cache
def vehicle(name: str = "tandem") -> Vehicle:
    return load_vehicle(VEHICLES / f"{name}.toml")


@cache
def _hovering(name: str, scenario: str, air: bool, seed: int, px4: bool) -> SimulatedFlight:
    flight = simulated(vehicle(name), build(scenario, vehicle(name), air=air), seed, px4=px4)
    flight.step()
    if not px4:  # which takes off in a mode of its own
        flight.autopilot.set_mode(Mode.GUIDED, flight.estimate)
    assert flight.autopilot.arm(True)
    assert flight.autopilot.take_off(HEIGHT_M, flight.estimate)
    fly(flight, 9.0)
    assert not flight.autopilot.landed
    return flight


class Peer:
    """The other end of a vehicle's link: keeps what it sends, and speaks to it."""

    def __init__(self, flight: SimulatedFlight) -> None:
        self.flight = flight
        self.frames: list[bytes] = []
        self.link = link_of(flight, self.frames.append)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True

    def run(self, seconds: float, each: Callable[[], None] | None = None) -> None:
        for _ in range(round(seconds / self.flight.body.dt)):
            if each is not None:
                each()
            self.flight.step()
            self.link.step()

    def say(self, message: Any, system: int = 1, component: int = 191) -> None:
        message.get_header().srcSystem, message.get_header().srcComponent = system, component
        self.link.hear(message)

    def messages(self, kind: str | None = None) -> list[Any]:
        """What has been sent since the last call."""
        found = [m for frame in self.frames for m in self._parser.parse_buffer(frame) or []]
        self.frames.clear()
        return [m for m in found if kind is None or m.get_type() == kind]

    def command(self, number: int, *params: float) -> int:
        """Send a COMMAND_LONG; the result of its acknowledgement."""
        p = [*params, *[0.0] * (7 - len(params))]
        self.frames.clear()
        self.say(mavlink.MAVLink_command_long_message(1, 1, number, 0, *p))
        acks = self.messages("COMMAND_ACK")
        assert [a.command for a in acks] == [number]
        return int(acks[0].result)

    def interval(self, number: int, hz: float) -> int:
        return self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 1e6 / hz)

    def attitude(
        self,
        roll: float = 0.0,
        pitch: float = 0.0,
        thrust: float = 0.5,
        *,
        mask: int = 7,
        scale: float = 1.0,
    ) -> None:
        """Angles in degrees."""
        q = [scale * v for v in quaternion_from_euler(math.radians(roll), math.radians(pitch), 0.0)]
        self.say(
            mavlink.MAVLink_set_attitude_target_message(
                self.link.boot_ms, 1, 1, mask, q, 0.0, 0.0, 0.0, thrust
            )
        )

    def position(self, n: float, e: float, d: float, *, accel_n: float | None = None) -> None:
        mask = 0x38 | 0x800 | (0x1C0 if accel_n is None else 0)
        self.say(
            mavlink.MAVLink_set_position_target_local_ned_message(
                self.link.boot_ms,
                1,
                1,
                1,
                mask,
                n,
                e,
                d,
                0.0,
                0.0,
                0.0,
                accel_n or 0.0,
                0.0,
                0.0,
                0.0,
                0.0,
            ),
            255,
            190,
        )


def fly(flight: SimulatedFlight, seconds: float) -> None:
    for _ in range(round(seconds / flight.body.dt)):
        flight.step()


def hovering(
    name: str = "tandem",
    scenario: str = "hover",
    *,
    air: bool = False,
    seed: int = 3,
    px4: bool = False,
) -> Peer:
    """A vehicle that hovers under GUIDED at 1.5 m."""
    return Peer(copy.deepcopy(_hovering(name, scenario, air, seed, px4)))


def sent_and_decided(log: Path, config: PipelineConfig) -> tuple[list[bytes], list[bytes]]:
    """Payloads of the setpoints that a recorded flight sent, and of those that its replay decides."""
    decisions = Replay(config).decisions(read_tlog(log).frames())
    decided = [encode(d.command, 1) for d in decisions if d.command is not None]
    frames = [cut(raw, 0) for _, raw in read_tlog(log).frames()]
    sent = [f.payload for f in frames if f.component == 191 and f.id == SET_ATTITUDE_TARGET]
    return [p.ljust(40, b"\0") for p in sent], [
        p.ljust(40, b"\0") for i, p in decided if i == SET_ATTITUDE_TARGET
    ]
