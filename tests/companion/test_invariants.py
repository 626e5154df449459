"""The promises of docs/safety.md, checked on whole simulated flights; and each of them found where it is broken."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from audited import fly_audited
from flight_case import Case, CasePilot
from simflight import vehicle

from companion.control.compensation import Offset
from companion.invariants.auditor import Auditor
from companion.invariants.requirements import Requirement
from companion.mavlink.dialect import mavlink
from companion.mavlink.setpoints import AttitudeCommand, PositionCommand, encode
from companion.mavlink.wire_frames import Frame, FrameReader, pack
from companion.sim.autopilot import Mode
from companion.state.decision import Decision
from models.common.frames import quaternion_from_euler
from replay.logs.tlog import read_tlog

SECONDS = 4.0


def hover_low(p: CasePilot) -> Iterator[float]:
    yield from p.take_off(0.6)
    yield from p.hand_over()
    p.judge()
    p.go(0.0, 0.0, 0.35)
    yield SECONDS
    p.mode(Mode.LOITER)
    yield 1.0


@pytest.mark.parametrize("px4", [False, True], ids=["ardupilot", "px4"])
def test_a_whole_flight_keeps_every_promise_on_every_output(px4, tmp_path: Path):
    log = tmp_path / "flight.tlog"
    world, _, audit = fly_audited(Case("low", "low hover", hover_low, px4=px4), record=log)
    assert audit.broken() == []
    assert world.companion.summary.as_json()["compensated_s"] > 1.0
    assert audit.setpoints > 40.0 * SECONDS
    looked_at = {p for p, kept in audit.requirements.items() if kept.checked}
    assert looked_at == set(Requirement) - {Requirement.DRY_RUN}
    # The recording alone tells the same, but for what only decisions hold.
    recorded = Auditor(vehicle())
    for arrival_us, raw in read_tlog(log).frames():
        recorded.frame(arrival_us, FrameReader().feed(raw)[0])
    assert recorded.audit.broken() == []
    assert recorded.audit.setpoints == audit.setpoints


def test_a_dry_run_sends_no_setpoint():
    _, _, audit = fly_audited(Case("low", "low hover", low_under_autopilot), dry_run=True)
    assert audit.broken() == []
    assert audit.setpoints == 0
    assert audit.sent > 20


def low_under_autopilot(p: CasePilot) -> Iterator[float]:
    yield from p.take_off(0.6)
    p.judge()
    yield 2.0


class Wire:
    """Speaks for vehicle and companion, straight into an auditor."""

    def __init__(self, px4: bool = False, **options: object) -> None:
        self.auditor = Auditor(vehicle("quad"), **options)  # type: ignore[arg-type]
        self.us, self.mav = (
            1_700_000_000_000_000,
            mavlink.MAVLink(None, srcSystem=1, srcComponent=1),
        )
        self.px4 = px4
        self.down_cm, self.rpm = 40, 4000
        self.tick(mode=6 << 16 if px4 else 4)

    @property
    def boot_ms(self) -> int:
        return (self.us - 1_700_000_000_000_000) // 1000 + 10_000

    def say(self, message) -> None:
        self.auditor.frame(self.us, FrameReader().feed(message.pack(self.mav))[0])

    def tick(
        self,
        seconds: float = 0.02,
        *,
        mode: int = 4,
        armed: bool = True,
        landed: int = 2,
        **silent: bool,
    ) -> None:
        """All that the vehicle says, some time later."""
        self.us += round(seconds * 1e6)
        m, ms = mavlink, self.boot_ms
        if not silent.get("heartbeat"):
            kind = 12 if self.px4 else 3
            self.say(m.MAVLink_heartbeat_message(2, kind, 128 if armed else 0, mode, 4, 3))
        self.say(m.MAVLink_extended_sys_state_message(0, landed))
        if not silent.get("attitude"):
            self.say(m.MAVLink_attitude_quaternion_message(ms, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        self.say(m.MAVLink_local_position_ned_message(ms, 0.0, 0.0, -0.4, 0.0, 0.0, 0.0))
        for sensor in vehicle("quad").rangefinders:
            cm = self.down_cm if sensor.orientation == 25 else 40
            if not silent.get("ranges"):
                self.say(
                    m.MAVLink_distance_sensor_message(ms, 5, 800, cm, 0, 0, sensor.orientation, 0)
                )
        if not silent.get("rotors"):
            count = [ms // 20 & 0xFFFF] * 4
            self.say(
                m.MAVLink_esc_telemetry_1_to_4_message(
                    [20] * 4, [0] * 4, [0] * 4, [0] * 4, [self.rpm] * 4, count
                )
            )

    def own(self, number: int, payload: bytes) -> None:
        raw = pack(number, payload, 1, 191, 0)
        self.auditor.frame(self.us, FrameReader().feed(raw)[0])

    def attitude(
        self, roll: float = 0.05, thrust: float = 0.5, ms: int | None = None, scale: float = 1.0
    ) -> None:
        q = tuple(scale * c for c in quaternion_from_euler(roll, 0.0, 0.0))
        stamp = self.boot_ms if ms is None else ms
        self.own(*encode(AttitudeCommand(stamp / 1000.0, q, thrust), 1))  # type: ignore[arg-type]

    def decide(self, thrust: float = 0.0, roll: float = 0.0) -> None:
        t_s = self.boot_ms / 1000.0
        command = AttitudeCommand(t_s, (1.0, 0.0, 0.0, 0.0), 0.5)
        self.auditor.decision(Decision(t_s, command, (), 1.0, Offset(thrust, roll), None, None))

    def broken(self) -> set[Requirement]:
        return {p for p, kept in self.auditor.audit.requirements.items() if kept.broken}


def run(seconds: float, wire: Wire, **state: object) -> None:
    for _ in range(round(seconds / 0.02)):
        wire.tick(**state)  # type: ignore[arg-type]
        wire.attitude()
        wire.decide(0.02)


def test_a_proper_exchange_breaks_nothing():
    wire = Wire()
    run(1.0, wire)
    assert wire.broken() == set()


def overlarge(w: Wire) -> None:
    run(0.5, w)
    w.decide(0.02, roll=0.3)


def leap(w: Wire) -> None:
    w.decide(0.0)
    w.tick()
    w.decide(0.05)


def disarmed(w: Wire) -> None:
    w.tick(armed=False)
    w.attitude()


def other_mode(w: Wire) -> None:
    w.tick(mode=5)
    w.attitude()


def on_the_ground(w: Wire) -> None:
    w.tick(landed=1)
    w.attitude()


def second_time(w: Wire) -> None:
    w.attitude()
    w.attitude()


def old(w: Wire) -> None:
    w.attitude(ms=w.boot_ms - 400)


def arms(w: Wire) -> None:
    message = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1.0, 0, 0, 0, 0, 0, 0)
    w.own(76, message.pack(mavlink.MAVLink(None))[10:-2])


def no_heartbeat(w: Wire) -> None:
    run(4.0, w, heartbeat=True)


def infinite_place(w: Wire) -> None:
    w.own(*encode(PositionCommand(w.boot_ms / 1000.0, (float("inf"), 0.0, 0.0), 0.0), 1))


BREAKS = {
    "offset beyond the limit": (overlarge, {Requirement.LIMITS, Requirement.SLEW}),
    "offset leaps": (leap, {Requirement.SLEW}),
    "half a quaternion": (lambda w: w.attitude(scale=0.5), {Requirement.QUATERNION}),
    "no quaternion": (lambda w: w.attitude(scale=float("nan")), {Requirement.QUATERNION}),
    "full throttle": (lambda w: w.attitude(thrust=1.0), {Requirement.THRUST}),
    "ranges lost": (lambda w: run(0.7, w, ranges=True), {Requirement.INPUT_LOST}),
    "rotor speeds lost": (lambda w: run(0.7, w, rotors=True), {Requirement.INPUT_LOST}),
    "disarmed": (disarmed, {Requirement.ARMED}),
    "another mode": (other_mode, {Requirement.MODE}),
    "on the ground": (on_the_ground, {Requirement.LANDED}),
    "no heartbeat": (no_heartbeat, {Requirement.LINK}),
    "sent a second time": (second_time, {Requirement.FRESH}),
    "old": (old, {Requirement.FRESH}),
    "arms": (arms, {Requirement.DECLARED}),
    "a message of its own": (lambda w: w.own(11, bytes(6)), {Requirement.DECLARED}),
    "infinite place": (infinite_place, {Requirement.FORM}),
}  # fmt: skip


@pytest.mark.parametrize("name", BREAKS)
def test_every_broken_promise_is_found_and_no_other(name):
    act, expected = BREAKS[name]
    wire = Wire()
    wire.tick()
    act(wire)
    assert wire.broken() == expected


@pytest.mark.parametrize(
    ("px4", "seconds", "broken"),
    [
        (True, 5.9, set()),
        (True, 7.0, {Requirement.FRESH}),
        (False, 1.5, set()),
        (False, 5.9, {Requirement.FRESH}),
    ],
)
def test_at_the_end_the_place_is_sent_for_six_seconds_on_px4_and_for_one_on_ardupilot(
    px4, seconds, broken
):
    wire = Wire(px4=px4)
    stamp_s = wire.boot_ms / 1000.0
    wire.tick(seconds, mode=6 << 16 if px4 else 4)
    wire.own(*encode(PositionCommand(stamp_s, (0.0, 0.0, -0.4), 0.0), 1))
    assert wire.broken() == broken


@pytest.mark.parametrize(
    ("down_cm", "rpm", "broken"),
    [(40, 4000, set()), (14, 4000, {Requirement.LANDED}), (40, 1000, {Requirement.LANDED})],
    ids=["in the air by both", "by rotors alone", "by the range alone"],
)
def test_a_land_detector_is_wrong_only_where_range_and_rotors_both_say_so(down_cm, rpm, broken):
    wire = Wire()
    wire.down_cm, wire.rpm = 12, 0
    for _ in range(5):
        wire.tick(landed=1)
    wire.down_cm, wire.rpm = 40, 4000
    run(1.0, wire)
    wire.down_cm, wire.rpm = down_cm, rpm
    wire.tick(landed=1)
    wire.attitude()
    assert wire.broken() == broken


def test_px4_before_offboard_may_be_told_to_stay_level_but_no_more():
    wire = Wire(px4=True)
    wire.tick(mode=3 << 16)
    wire.attitude(roll=0.0)
    assert wire.broken() == set()
    wire.tick(mode=3 << 16)
    wire.attitude(roll=0.1)
    assert wire.broken() == {Requirement.MODE}


def test_a_dry_run_that_sends_is_found():
    wire = Wire(dry_run=True)
    wire.tick()
    wire.attitude()
    assert wire.broken() == {Requirement.DRY_RUN}


def test_of_an_upstream_controller_only_what_is_added_is_ours():
    for added, expected in ((0.05, set()), (0.4, {Requirement.LIMITS})):
        wire = Wire(hold=False)
        wire.tick()
        q = quaternion_from_euler(0.5, 0.0, 0.0)
        upstream = mavlink.MAVLink_set_attitude_target_message(
            0, 1, 191, 7, list(q), 0.0, 0.0, 0.0, 1.0
        )
        wire.auditor.frame(
            wire.us, FrameReader().feed(upstream.pack(mavlink.MAVLink(None, 255, 1)))[0]
        )
        wire.attitude(roll=0.5 + added, thrust=1.0)
        assert wire.broken() == expected


def test_frames_of_other_companions_are_not_ours():
    wire = Wire()
    wire.tick()
    payload = bytes(6)
    wire.auditor.frame(wire.us, Frame(11, 9, 191, payload, pack(11, payload, 9, 191, 0)))
    assert wire.broken() == set()
    assert replace(wire.auditor.audit).kept
