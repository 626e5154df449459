"""The faults."""

from __future__ import annotations

import errno
import math
import os
import struct
from collections.abc import Callable, Iterator
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simulated import is_px4
from vision import VisionEstimator

from companion.adapt_options import Adapt
from companion.mavlink.tlog_writer import Recorder
from companion.mavlink.wire_frames import pack
from companion.sim.autopilot import Mode
from faults.campaign import LOW_M, WALL_M, Act, Bench, Fault, Result, fly, silent_drift_m
from faults.tamper import signed, signer

HEARTBEAT = 0
ATTITUDE = 31
POSITION = 32
RANGE = 132
RING = 330
ESC = 11030
ESC_STATUS = 291
ESC_INFO = 290
LANDED = 245
DOWN = 25
WALL = 2
ROTORS = (ESC, ESC_STATUS)


def silent(*numbers: int) -> Act:
    """These messages stop."""

    def begin(b: Bench) -> None:
        for number in numbers:
            b.tamper.edits[number] = lambda _: False

    return begin


def ranges(orientation: int, change: Callable[[Any, Bench], bool | None]) -> Act:
    """Readings of one rangefinder change."""

    def begin(b: Bench) -> None:
        def edit(m: Any) -> bool | None:
            return change(m, b) if m.orientation == orientation else None

        b.tamper.edits[RANGE] = edit

    return begin


def shift(cm: int) -> Callable[[Any, Bench], None]:
    def change(m: Any, _: Bench) -> None:
        m.current_distance = max(m.current_distance + cm, 0)

    return change


def scaled(by: float) -> Callable[[Any, Bench], None]:
    def change(m: Any, _: Bench) -> None:
        m.current_distance = min(round(m.current_distance * by), 65535)

    return change


def reads(cm: int) -> Callable[[Any, Bench], None]:
    def change(m: Any, _: Bench) -> None:
        m.current_distance = cm

    return change


def quantised(m: Any, _: Bench) -> None:
    m.current_distance = 10 * round(m.current_distance / 10)


def noisy(m: Any, b: Bench) -> None:
    m.current_distance = max(round(m.current_distance + b.tamper.rng.gauss(0.0, 20.0)), 0)


def dropping_out(m: Any, b: Bench) -> None:
    if b.tamper.rng.random() < 0.5:
        m.current_distance = 6000


def doubtful(m: Any, _: Bench) -> None:
    m.signal_quality = 1


def frozen_then_move(orientation: int, east: float, up: float) -> Act:
    """A reading repeats itself; a moment later the vehicle is sent elsewhere."""

    def begin(b: Bench) -> None:
        held: list[int] = []

        def change(m: Any, _: Bench) -> None:
            held.append(m.current_distance)
            m.current_distance = held[0]

        ranges(orientation, change)(b)
        _, e, d = b.flight.body.position
        b.pilot.go(0.0, e + east, up - d)
        b.pilot.judge(east=east, up=up)

    return begin


def frozen_ring(east: float) -> Act:
    """The half of a ring that looks at the wall repeats itself; a moment later the vehicle is sent elsewhere."""

    def begin(b: Bench) -> None:
        held: list[list[int]] = []

        def edit(m: Any) -> None:
            held.append(list(m.distances))
            m.distances = [*held[0][:5], *m.distances[5:]]

        b.tamper.edits[RING] = edit
        _, e, d = b.flight.body.position
        b.pilot.go(0.0, e + east, -d)
        b.pilot.judge(east=east)

    return begin


def frozen_position(b: Bench) -> None:
    held: list[tuple[float, ...]] = []

    def edit(m: Any) -> None:
        held.append((m.x, m.y, m.z, m.vx, m.vy, m.vz))
        m.x, m.y, m.z, m.vx, m.vy, m.vz = held[0]

    b.tamper.edits[POSITION] = edit


def swapped(b: Bench) -> None:
    def edit(m: Any) -> None:
        m.orientation = {DOWN: WALL, WALL: DOWN}.get(m.orientation, m.orientation)

    b.tamper.edits[RANGE] = edit


def spoofed(system: int, component: int) -> Act:
    """Another component says that the ground is 12 cm away."""

    def each(b: Bench) -> None:
        message = mavlink.MAVLink_distance_sensor_message(
            round(b.now_s * 1000.0), 3, 4000, 12, 0, 0, DOWN, 255, 0.0, 0.0, [0.0] * 4, 100
        )
        b.tamper.say(message, b.now_s, system, component)

    return each


def rotors(change: Callable[[list[float], Bench], list[float]], count: bool = True) -> Act:
    """The speeds of the four ESCs change; ``count`` False: the telemetry counter stands still."""

    def begin(b: Bench) -> None:
        def edit(m: Any) -> None:
            m.rpm = [max(0, min(65535, round(v))) for v in change(list(m.rpm), b)]
            if not count:
                m.count = [7] * 4

        def path(frame: bytes) -> list[tuple[float, bytes]]:
            if int.from_bytes(frame[7:10], "little") != ESC_STATUS:
                return [(0.0, frame)]
            payload = frame[10:-2].ljust(57, b"\0")
            values = change(list(struct.unpack_from("<4i", payload, 8)), b)
            packed = struct.pack("<4i", *(max(-(2**31), min(2**31 - 1, round(v))) for v in values))
            return [
                (
                    0.0,
                    pack(
                        ESC_STATUS,
                        payload[:8] + packed + payload[24:],
                        frame[5],
                        frame[6],
                        frame[4],
                    ),
                )
            ]

        b.tamper.edits[ESC] = edit
        b.tamper.paths.append(path)

    return begin


def frozen_speeds(b: Bench) -> None:
    held: list[list[float]] = []

    def change(rpm: list[float], _: Bench) -> list[float]:
        held.append(rpm)
        return held[0]

    rotors(change, count=False)(b)


def shifted_group(b: Bench) -> None:
    """The ESCs come as numbers 5 to 8."""

    def path(frame: bytes) -> list[tuple[float, bytes]]:
        number = int.from_bytes(frame[7:10], "little")
        if number == ESC:
            message = b.tamper._parser.parse_buffer(frame)[0]
            other = mavlink.MAVLink_esc_telemetry_5_to_8_message(
                message.temperature,
                message.voltage,
                message.current,
                message.totalcurrent,
                message.rpm,
                message.count,
            )
            return [(0.0, other.pack(mavlink.MAVLink(None, 1, 1)))]
        if number == ESC_STATUS:
            payload = frame[10:-2].ljust(57, b"\0")
            return [(0.0, pack(ESC_STATUS, payload[:56] + b"\4", frame[5], frame[6], frame[4]))]
        return [(0.0, frame)]

    b.tamper.paths.append(path)


def every_frame(path: Callable[[bytes, Bench], list[tuple[float, bytes]]]) -> Act:
    """Something happens to all that the vehicle sends."""

    def begin(b: Bench) -> None:
        b.tamper.paths.append(lambda frame: path(frame, b))

    return begin


def lost(_: bytes, __: Bench) -> list[tuple[float, bytes]]:
    return []


def delayed(seconds: float) -> Callable[[bytes, Bench], list[tuple[float, bytes]]]:
    return lambda frame, _: [(seconds, frame)]


def jittered(frame: bytes, b: Bench) -> list[tuple[float, bytes]]:
    return [(b.tamper.rng.uniform(0.0, 0.06), frame)]


def doubled(frame: bytes, b: Bench) -> list[tuple[float, bytes]]:
    return [(0.0, frame), (b.tamper.rng.uniform(0.0, 0.02), frame)]


def some_lost(frame: bytes, b: Bench) -> list[tuple[float, bytes]]:
    return [] if b.tamper.rng.random() < 0.2 else [(0.0, frame)]


def bits_flipped(frame: bytes, b: Bench) -> list[tuple[float, bytes]]:
    if b.tamper.rng.random() > 0.1:
        return [(0.0, frame)]
    raw = bytearray(frame)
    raw[b.tamper.rng.randrange(len(raw))] ^= 1 << b.tamper.rng.randrange(8)
    return [(0.0, bytes(raw))]


def cut_short(frame: bytes, b: Bench) -> list[tuple[float, bytes]]:
    return [
        (
            0.0,
            frame[: b.tamper.rng.randrange(1, len(frame))]
            if b.tamper.rng.random() < 0.1
            else frame,
        )
    ]


def forged(key: bytes | None) -> Act:
    """Somebody speaks as the vehicle: tilted by 74 degrees, 12 cm high, disarmed. Unsigned, or with another key."""

    def each(b: Bench) -> None:
        ms = round(b.now_s * 1000.0)
        sign = None if key is None else signer(key)
        for message in (
            mavlink.MAVLink_heartbeat_message(2, 3, 0, 5, 3, 3),
            mavlink.MAVLink_attitude_quaternion_message(ms, 0.8, 0.6, 0.0, 0.0, 0.0, 0.0, 0.0),
            mavlink.MAVLink_distance_sensor_message(
                ms, 3, 4000, 12, 0, 0, DOWN, 255, 0.0, 0.0, [0.0] * 4, 100
            ),
        ):
            raw = message.pack(mavlink.MAVLink(None, 1, 1))
            b.tamper.inject(raw if sign is None else signed(raw, sign), b.now_s)

    return each


def replayed() -> tuple[Act, Act]:
    """(begin, each): what the vehicle signed and sent is heard, and sent again two seconds later."""
    heard: list[tuple[float, bytes]] = []

    def begin(b: Bench) -> None:
        heard.clear()
        send = b.tamper._send

        def listen(frame: bytes, now_s: float) -> None:
            heard.append((now_s, frame))
            send(frame, now_s)

        b.tamper._send = listen

    def each(b: Bench) -> None:
        while heard and heard[0][0] <= b.now_s - 2.0:
            b.world.wire._down.append((b.now_s, heard.pop(0)[1]))

    return begin, each


def land_and_take_off(b: Bench) -> Iterator[float]:
    """Down beside the wall, up again there, 0.55 m from it: nearer PX4's own take-off drifts against the wall."""
    place = WALL_M - 0.55
    b.pilot.go(0.0, place, LOW_M)
    yield 2.0
    b.pilot.judge()
    b.pilot.mode(Mode.LAND)
    for _ in range(100):
        yield 0.1
        if b.flight.autopilot.landed and not b.flight.autopilot.armed:
            break
    if is_px4(b.flight):
        b.pilot.mode(Mode.POSHOLD)  # armed in LAND it would disarm again
    yield from b.pilot.take_off(LOW_M)
    yield from b.pilot.hand_over()


def replaced_model(b: Bench) -> None:
    """Somebody writes another file over the model that flies."""
    for path in (b.folder / "model").iterdir():
        path.write_bytes(b"another model" * 100)


def second_autopilot(b: Bench) -> None:
    ms = round(b.now_s * 1000.0)
    if ms % 100 < 10:
        b.tamper.say(mavlink.MAVLink_heartbeat_message(2, 3, 0, 5, 3, 3), b.now_s, 2, 1)
        b.tamper.say(
            mavlink.MAVLink_local_position_ned_message(ms, 50.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            b.now_s,
            2,
            1,
        )
    b.tamper.say(
        mavlink.MAVLink_attitude_quaternion_message(ms, 0.8, 0.6, 0.0, 0.0, 0.0, 0.0, 0.0),
        b.now_s,
        2,
        1,
    )


def other_station(b: Bench) -> None:
    """A ground station turns down what we need."""
    for number in (ATTITUDE, POSITION, RANGE, ESC, ESC_STATUS):
        command = mavlink.MAVLink_command_long_message(
            1, 1, 511, 0, number, 1e6, 0.0, 0.0, 0.0, 0.0, 0.0
        )
        b.world.link.hear(command)


def moved_position(north: float) -> Act:
    """The estimate leaps; stays there."""

    def begin(b: Bench) -> None:
        def edit(m: Any) -> None:
            m.x += north

        b.tamper.edits[POSITION] = edit

    return begin


def vision(b: Bench) -> VisionEstimator:
    """The vehicle's odometry."""
    assert isinstance(b.flight.estimator, VisionEstimator)
    return b.flight.estimator


def relocalised(east: float) -> Act:
    """The odometry finds its place again, so far from where it was; the pilot's old places are no more."""

    def begin(b: Bench) -> None:
        b.pilot.silent()
        vision(b).relocalise((0.0, east, 0.0))

    return begin


def to_and_fro(b: Bench) -> Iterator[float]:
    """Along the wall, 6 m in all, while the odometry drifts by 2 % of it towards the wall."""
    odometry = vision(b)
    odometry.drifts = (0.0, -1.0, 0.0)
    _, e, d = b.flight.estimate.position
    for north in (0.6, -0.6, 0.6, -0.6, 0.6, 0.0):
        b.pilot.go(north, e, -d)
        yield 3.0


def reset_position(b: Bench) -> None:
    """The pilot sends no more targets: those would be places of the old frame, and be flown to."""
    b.pilot.silent()
    moved_position(1.0)(b)


def drifting_height(up_m_s: float, velocity: bool = False) -> Act:
    """The height estimate drifts; with ``velocity`` the vertical velocity says the same."""

    def begin(b: Bench) -> None:
        start = b.now_s

        def edit(m: Any) -> None:
            m.z -= up_m_s * (b.now_s - start)
            m.vz -= up_m_s * velocity

        b.tamper.edits[POSITION] = edit

    return begin


def not_a_number(number: int, *names: str) -> Act:
    def begin(b: Bench) -> None:
        def edit(m: Any) -> None:
            for name in names:
                setattr(m, name, math.nan)

        b.tamper.edits[number] = edit

    return begin


def long_quaternion(b: Bench) -> None:
    def edit(m: Any) -> None:
        m.q1, m.q2, m.q3, m.q4 = (3.0 * q for q in (m.q1, m.q2, m.q3, m.q4))

    b.tamper.edits[ATTITUDE] = edit


def biased_attitude(roll_rad: float) -> Act:
    """Attitudes say that the vehicle rolls more than it does."""

    def begin(b: Bench) -> None:
        c = math.cos(0.5 * roll_rad)
        s = math.sin(0.5 * roll_rad)

        def edit(m: Any) -> None:
            m.q1, m.q2, m.q3, m.q4 = (
                m.q1 * c - m.q2 * s,
                m.q2 * c + m.q1 * s,
                m.q3 * c + m.q4 * s,
                m.q4 * c - m.q3 * s,
            )

        b.tamper.edits[ATTITUDE] = edit

    return begin


def frozen_attitude(b: Bench) -> None:
    held: list[Any] = []

    def edit(m: Any) -> None:
        held.append((m.q1, m.q2, m.q3, m.q4))
        m.q1, m.q2, m.q3, m.q4 = held[0]

    b.tamper.edits[ATTITUDE] = edit


def clock_back(b: Bench) -> None:
    b.tamper.clock_ms -= 5000


def clock_ahead(b: Bench) -> None:
    b.tamper.clock_ms += 30_000


def rebooted_clock(b: Bench) -> None:
    b.tamper.clock_ms -= round(b.now_s * 1000.0) - 500


def to_loiter(b: Bench) -> None:
    b.pilot.mode(Mode.LOITER)


def to_guided(b: Bench) -> None:
    b.pilot.mode(Mode.GUIDED)


def to_land(b: Bench) -> None:
    b.pilot.mode(Mode.LAND)


def says_disarmed(b: Bench) -> None:
    def edit(m: Any) -> None:
        m.base_mode &= ~128

    b.tamper.edits[HEARTBEAT] = edit


def says_landed(b: Bench) -> None:
    def edit(m: Any) -> None:
        m.landed_state = 1

    b.tamper.edits[LANDED] = edit


def stalled(seconds: float) -> Act:
    return lambda b: b.world.stall(seconds)


def starved(period_s: float) -> Act:
    """The companion gets its turn once in a period, for 5 ms."""

    def each(b: Bench) -> None:
        if b.now_s >= b.world.stalled_until_s + 0.005:
            b.world.stall(period_s - 0.005)

    return each


def killed(b: Bench) -> None:
    b.world.kill(1.0)


def disk(number: int) -> Act:
    """A recorder whose disk fails in flight."""

    def begin(b: Bench) -> None:
        said: list[str] = []
        recorder = Recorder(b.folder / "flight.tlog", say=said.append)

        class Failing:
            def write(self, _: bytes) -> int:
                raise OSError(number, os.strerror(number))

            def close(self) -> None:
                return

        recorder._file = Failing()  # type: ignore[assignment]
        companion = b.world.companion
        assert companion is not None
        inner = companion.outbox.recorder

        class Both:
            def write(self, arrival_us: int, raw: bytes) -> None:
                inner.write(arrival_us, raw)  # type: ignore[union-attr]
                recorder.write(arrival_us, raw)

            def flush(self) -> None:
                recorder.flush()

        companion.outbox.recorder = Both()
        b.pilot.notes.append("disk")

    return begin


def wind(b: Bench) -> None:
    b.flight.body.wind = (2.0, 1.5, 0.0)


def rising_wind() -> tuple[Act, Act]:
    """(begin, each): as strong, within a second, as outdoors."""
    start: list[float] = []

    def begin(b: Bench) -> None:
        start[:] = [b.now_s]

    def each(b: Bench) -> None:
        share = min(b.now_s - start[0], 1.0)
        b.flight.body.wind = (2.0 * share, 1.5 * share, 0.0)

    return begin, each


def calm(b: Bench) -> None:
    b.flight.body.wind = (0.0, 0.0, 0.0)


def bit_cleared(b: Bench) -> None:
    """Somebody clears GUID_OPTIONS bit 3 in flight: thrust would be read as a climb rate."""
    b.flight.autopilot.set_parameter("GUID_OPTIONS", 0.0)
    b.tamper.say(mavlink.MAVLink_param_value_message(b"GUID_OPTIONS", 0.0, 9, 2, 0), b.now_s)


def bit_set(b: Bench) -> None:
    b.flight.autopilot.set_parameter("GUID_OPTIONS", 8.0)
    b.tamper.say(mavlink.MAVLink_param_value_message(b"GUID_OPTIONS", 8.0, 9, 2, 0), b.now_s)
    b.pilot.mode(Mode.GUIDED)


def nothing(_: Bench) -> None:
    return


AP = ("ardupilot",)
PX4 = ("px4",)
KEY = bytes(range(32))
REPLAY = replayed()
RISING = rising_wind()
PUSHED_OFF_M = 0.45
"""The same push, 2.6 m/s^2 in all, against a position stiffness of 2.2 x 5 1/s^2 is 0.24 m until the integral has it,
and more while the tilt is at its limit of 15 degrees."""
GUST_OFF_M = 0.5
GUST_TOUCHES_S = 0.5
"""A gust that is there at once pushes the ducts and, through vanes that hold their moment off, the vehicle: 2.3 m/s^2
towards the wall. It is 0.30 m away. The full tilt away from it, commanded in the very instant of the gust, lets the
vehicle come 0.3 m nearer before it stops: ``python tests/benchmarks faults.gust_limit``. More than a touch is not
allowed."""

FAULTS = (
    # ranges
    Fault("range_down_silent", "the ground range stops", ranges(DOWN, lambda *_: False)),
    Fault("range_wall_silent", "the wall range stops", ranges(WALL, lambda *_: False)),
    Fault("ranges_silent", "all ranges stop", silent(RANGE)),
    Fault("range_down_frozen", "the ground range repeats itself, then a climb", frozen_then_move(DOWN, 0.0, 0.4),
          seconds=5.0, off_m=0.5),
    Fault("range_wall_frozen", "the wall range repeats itself, then away from the wall",
          frozen_then_move(WALL, -0.5, 0.0), seconds=5.0, off_m=0.6),
    Fault("ring_frozen", "directions of a ring to the wall repeat themselves, then away from the wall",
          frozen_ring(-0.5), seconds=5.0, off_m=0.6, ring=8),
    Fault("range_down_no_echo", "the ground range reads out of range", ranges(DOWN, reads(6000))),
    Fault("range_wall_no_echo", "the wall range reads out of range", ranges(WALL, reads(6000))),
    Fault("range_down_jump_up", "the ground range jumps by +0.5 m", ranges(DOWN, shift(50))),
    Fault("range_down_jump_down", "the ground range jumps by -0.15 m", ranges(DOWN, shift(-15))),
    Fault("range_wall_jump", "the wall range jumps by +0.4 m", ranges(WALL, shift(40))),
    Fault("range_down_biased", "the ground range reads 3 cm more", ranges(DOWN, shift(3)), noticed=False),
    Fault("range_wall_biased", "the wall range reads 3 cm more", ranges(WALL, shift(3)), noticed=False),
    Fault("ranges_swapped", "wall for ground and ground for wall", swapped, noticed=False),
    Fault("range_down_quantised", "the ground range in steps of 10 cm", ranges(DOWN, quantised), noticed=False),
    Fault("range_down_noisy", "20 cm of noise on the ground range", ranges(DOWN, noisy), noticed=False),
    Fault("range_down_drops_out", "every other reading of the ground range is lost", ranges(DOWN, dropping_out),
          noticed=False),
    Fault("range_down_millimetres", "the ground range in mm, called cm", ranges(DOWN, scaled(10.0))),
    Fault("range_down_inches", "the ground range in inches, called cm", ranges(DOWN, scaled(1 / 2.54))),
    Fault("range_down_zero", "the ground range reads 0", ranges(DOWN, reads(0))),
    Fault("range_down_doubtful", "the ground range's quality falls to 1", ranges(DOWN, doubtful)),
    Fault("range_spoofed", "another component says the ground is 12 cm away", nothing, each=spoofed(1, 50),
          noticed=False),
    Fault("range_spoofed_other_system", "another system says so", nothing, each=spoofed(7, 1), noticed=False),
    # rotors
    Fault("rotors_silent", "no rotor speeds", silent(*ROTORS, ESC_INFO)),
    Fault("rotors_zero", "all rotor speeds read 0", rotors(lambda rpm, _: [0.0] * 4)),
    Fault("rotor_one_zero", "one rotor speed reads 0", rotors(lambda rpm, _: [0.0, *rpm[1:]])),
    Fault("rotors_doubled", "rotor speeds doubled (pole count)", rotors(lambda rpm, _: [2.0 * v for v in rpm])),
    Fault("rotors_biased", "rotor speeds 5 % too high", rotors(lambda rpm, _: [1.05 * v for v in rpm]),
          noticed=False),
    Fault("rotors_quantised", "rotor speeds in steps of 400 rpm",
          rotors(lambda rpm, _: [400.0 * round(v / 400.0) for v in rpm]), noticed=False),
    Fault("rotors_drop_out", "every third reading of the rotor speeds is 0",
          rotors(lambda rpm, b: [0.0] * 4 if b.tamper.rng.random() < 0.33 else rpm), noticed=False),
    Fault("rotors_next_motor", "every speed credited to the next motor", rotors(lambda rpm, _: [*rpm[1:], rpm[0]]),
          noticed=False),
    Fault("rotors_esc_shift", "ESCs come as numbers 5 to 8", shifted_group),
    Fault("rotors_frozen", "the ESC telemetry repeats itself", frozen_speeds, noticed=False),
    Fault("rotors_absurd", "rotor speeds read 65535", rotors(lambda rpm, _: [65535.0] * 4)),
    # link
    Fault("link_lost_0.1s", "nothing arrives for 0.1 s", every_frame(lost), seconds=0.1, noticed=False),
    Fault("link_lost_0.5s", "nothing arrives for 0.5 s", every_frame(lost), seconds=0.5),
    Fault("link_lost_1s", "nothing arrives for 1 s", every_frame(lost), seconds=1.0),
    Fault("link_lost_3s", "nothing arrives for 3 s", every_frame(lost), seconds=3.0, recovers=False, off_m=1.0),
    Fault("link_lost_10s", "nothing arrives for 10 s", every_frame(lost), seconds=10.0, recovers=False, off_m=3.0),
    Fault("link_lost_30s", "nothing arrives for 30 s", every_frame(lost), seconds=30.0, recovers=False, off_m=9.0),
    Fault("link_late_0.2s", "everything 0.2 s late", every_frame(delayed(0.2))),
    Fault("link_late_0.6s", "everything 0.6 s late", every_frame(delayed(0.6)), off_m=0.5),
    Fault("link_reordered", "up to 60 ms late, each message by another time", every_frame(jittered), noticed=False),
    Fault("link_doubled", "every datagram twice", every_frame(doubled), noticed=False),
    Fault("link_lossy", "every fifth datagram is lost", every_frame(some_lost), noticed=False),
    Fault("link_bits_flipped", "a bit flipped in every tenth frame", every_frame(bits_flipped), noticed=False),
    Fault("link_cut_short", "every tenth frame cut short", every_frame(cut_short), noticed=False),
    Fault("unsigned_packets", "signed link; somebody speaks unsigned as the vehicle", nothing, each=forged(None),
          key=KEY, noticed=False),
    Fault("wrong_key_packets", "signed link; somebody speaks as the vehicle with another key", nothing,
          each=forged(bytes(32)), key=KEY, noticed=False),
    Fault("replayed_packets", "signed link; what the vehicle said is said again 2 s later", REPLAY[0], each=REPLAY[1],
          key=KEY, noticed=False, seconds=6.0),
    # autopilot
    Fault("attitude_silent", "attitudes stop", silent(ATTITUDE, 30)),
    Fault("attitude_nan", "attitudes are not numbers", not_a_number(ATTITUDE, "q1", "q2")),
    Fault("attitude_not_unit", "quaternions three times too long", long_quaternion, noticed=False),
    Fault("attitude_biased", "attitudes say 3 degrees more roll", biased_attitude(math.radians(3.0)), noticed=False),
    Fault("attitude_frozen", "the attitude repeats itself under fresh stamps", frozen_attitude, seconds=1.0,
          noticed=False, off_m=0.5),
    Fault("position_silent", "local positions stop", silent(POSITION), seconds=2.0),
    Fault("position_nan", "local positions are not numbers", not_a_number(POSITION, "x", "vx"), seconds=2.0),
    Fault("position_frozen", "the position repeats itself under fresh stamps", frozen_position, seconds=1.0,
          noticed=False),
    Fault("position_reset_1m", "the position estimate leaps by 1 m", reset_position, end=nothing, noticed=False),
    Fault("height_drifts", "the EKF's height drifts by 0.1 m/s against the range", drifting_height(0.1), seconds=4.0),
    Fault("height_drifts_down", "the same downward", drifting_height(-0.1), seconds=4.0),
    Fault("height_drifts_fast", "the EKF's height drifts by 0.25 m/s", drifting_height(0.25), seconds=4.0, off_m=0.3),
    Fault("height_and_velocity_drift", "height and vertical velocity drift by 0.1 m/s", drifting_height(0.1, True),
          seconds=4.0, off_m=0.3),
    Fault("gps_lost", "GPS lost for 6 s", lambda b: setattr(b.flight.estimator, "gps", False),
          end=lambda b: setattr(b.flight.estimator, "gps", True), seconds=6.0, noticed=False, off_m=0.6, lands=AP),
    Fault("vision_relocalises", "visual odometry finds its place again 0.25 m from where it was", relocalised(-0.25),
          end=nothing, noticed=False, off_m=0.12, vision=True),
    Fault("vision_freezes", "visual odometry repeats its last place under fresh stamps",
          lambda b: vision(b).freeze(True), end=lambda b: vision(b).freeze(False), seconds=4.0, noticed=False,
          off_m=0.75, vision=True),
    Fault("vision_turned", "visual odometry goes on in a frame that is turned by 90 degrees",
          lambda b: vision(b).turn(0.5 * math.pi), end=lambda b: vision(b).turn(0.0), seconds=4.0, noticed=False,
          vision=True),
    Fault("vision_drifts", "visual odometry drifts to the wall by 2 % of 6 m flown along it", nothing,
          during=to_and_fro, end=nothing, noticed=False, off_m=1.35, vision=True),
    Fault("heartbeat_silent", "heartbeats stop", silent(HEARTBEAT), seconds=5.0),
    Fault("clock_back_5s", "the autopilot's clock leaps back by 5 s", clock_back, end=nothing, recovers=False),
    Fault("clock_ahead_30s", "the autopilot's clock leaps ahead by 30 s", clock_ahead, end=nothing, noticed=False),
    Fault("clock_rebooted", "the autopilot's clock starts at 0 in flight", rebooted_clock, end=nothing,
          recovers=False),
    Fault("clock_wraps", "49.7 days: the clock wraps", nothing, clock_ms=2**32 - 24_000, noticed=False),
    Fault("second_autopilot", "a second, disarmed autopilot speaks on the link", nothing, each=second_autopilot,
          noticed=False),
    Fault("other_station_rates", "a ground station turns our messages down to 1 Hz", other_station),
    Fault("says_disarmed", "heartbeats say disarmed", says_disarmed, silent_off_m=silent_drift_m(3.0)),
    Fault("says_landed", "the land detector is wrong", says_landed, noticed=False),
    Fault("mode_change", "the pilot takes over in LOITER", to_loiter, end=to_guided),
    Fault("landing", "the pilot lands beside the wall", to_land, recovers=False, seconds=8.0, off_m=0.6,
          lands=(*AP, *PX4)),
    Fault("take_off_beside_wall", "lands beside the wall, and takes off there", nothing, during=land_and_take_off,
          off_m=0.6, lands=(*AP, *PX4)),
    Fault("guid_options_cleared", "GUID_OPTIONS bit 3 is cleared in flight", bit_cleared, end=bit_set, stacks=AP,
          off_m=0.4),
    Fault("wind_gust", "a gust of 2.5 m/s", wind, end=calm, noticed=False, off_m=GUST_OFF_M,
          touches_s=GUST_TOUCHES_S),
    Fault("wind_rises", "a wind that rises to 2.5 m/s within a second", RISING[0], each=RISING[1], end=calm,
          noticed=False, off_m=PUSHED_OFF_M),
    # the computer
    Fault("stalled_0.5s", "the companion stands still for 0.5 s", stalled(0.5)),
    Fault("stalled_1.5s", "the companion stands still for 1.5 s", stalled(1.5)),
    Fault("stalled_3s", "the companion stands still for 3 s", stalled(3.0), recovers=False, off_m=1.0),
    Fault("starved", "the companion gets its turn every 80 ms", nothing, each=starved(0.08), noticed=False),
    Fault("starved_0.8s", "the companion gets its turn every 0.8 s", nothing, each=starved(0.8)),
    Fault("killed_restarted", "SIGKILL in the air, back after 1 s", killed, recovers=False, off_m=1.0),
    Fault("interrupted", "SIGTERM in the air", lambda b: b.world.interrupt(), recovers=False, off_m=0.4),
    Fault("model_replaced", "another file is written over the model that flies", replaced_model, own_model=True,
          noticed=False),
    Fault("disk_full", "the disk runs full", disk(errno.ENOSPC), noticed=False),
    Fault("disk_read_only", "the record folder turns read-only", disk(errno.EROFS), noticed=False),
)  # fmt: skip
"""Each is flown with both manners of the simulated autopilot, unless it says otherwise."""

BY_NAME = {fault.name: fault for fault in FAULTS}


def fly_named(job: tuple[str, str, int], adapt: Adapt = Adapt.OFF) -> Result:
    """Name, stack and seed: what a worker process gets."""
    name, stack, seed = job
    return fly(BY_NAME[name], stack, seed, adapt)
