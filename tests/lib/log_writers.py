"""Writes small logs with known content: .tlog, .BIN and .ulg; and the data set of a fan."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from companion.mavlink.dialect import mavlink
from companion.mavlink.esc_messages import ESC_INFO, ESC_STATUS
from companion.mavlink.wire_frames import pack
from models.common.frames import GRAVITY, Array
from models.dataset import HEADER, DataSet

EPOCH_US = 1_767_225_600_000_000


def record(arrival_us: int, frame: bytes) -> bytes:
    return struct.pack(">Q", arrival_us) + frame


def frame(
    message,
    system: int = 1,
    component: int = 1,
    sequence: int = 0,
    *,
    v1: bool = False,
    key: bytes | None = None,
):
    link = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    link.seq = sequence
    if key is not None:
        link.signing.secret_key = key
        link.signing.sign_outgoing = True
        link.signing.link_id = 0
        link.signing.timestamp = 1
    return bytes(message.pack(link, force_mavlink1=v1))


def heartbeat(armed: bool = True, autopilot: int = 3, mode: int = 4, kind: int = 2):
    return mavlink.MAVLink_heartbeat_message(kind, autopilot, 128 * armed + 1, mode, 4, 3)


Wire = tuple[int, bytes]
"""Number and payload of a message that the dialect lacks."""


def flight(
    seconds: float = 10.0,
    start_ms: int = 40_000,
    arrival_us: int = EPOCH_US,
    system: int = 1,
    latency_us: int = 2_000,
    *,
    px4: bool = False,
    armed: bool = True,
    drift: float = 0.0,
) -> list[tuple[int, bytes]]:
    """A hovering vehicle at 50 Hz: roll 0.1 sin t, height 0.5 m, 4000 rpm + 10 per ESC, 16.8 V falling 0.01 V/s."""
    out: list[tuple[int, bytes]] = []
    for number, (t_us, message) in enumerate(_hover(seconds, start_ms, px4=px4, armed=armed)):
        if isinstance(message, tuple):
            raw = pack(*message, system, 1, number % 256)
        else:
            raw = frame(message, system, 1, number % 256)
        # A latency of its own for every message, never below the smallest.
        late = latency_us + ((number + 1) * 7919) % 3000
        out.append((arrival_us + int(t_us * (1.0 + drift)) + late, raw))
    return sorted(out, key=lambda item: item[0])


def _hover(
    seconds: float,
    start_ms: int,
    *,
    px4: bool,
    armed: bool,
) -> Iterator[tuple[int, object | Wire]]:
    """Messages with their time since the start [us]."""
    for k in range(round(seconds * 50)):
        ms = start_ms + k * 20
        if k % 50 == 0:
            yield k * 20_000, heartbeat(armed, 12 if px4 else 3, 6 << 16 if px4 else 4)
        for every, said in (
            (1, _state(ms)),
            (3, _distances(ms, lost=k % 30 == 0)),
            (2, _escs(ms, k, px4=px4)),
            (25, _power(ms, since_ms=k * 20, px4=px4)),
        ):
            for message in said if k % every == 0 else ():
                yield k * 20_000, message
    yield 100_000, mavlink.MAVLink_param_value_message(b"GUID_OPTIONS", 8.0, 6, 1, 0)


def _state(ms: int) -> Iterator[object]:
    t = ms / 1000.0
    us = ms * 1000
    roll = 0.1 * math.sin(t)
    p = 0.1 * math.cos(t)
    force = (0.1, -0.2, -9.8)
    outputs = (1500, 1510, 1520, 1530, 1490)
    yield mavlink.MAVLink_attitude_message(ms, roll, 0.02, 0.3, p, 0.0, 0.0)
    yield mavlink.MAVLink_highres_imu_message(us, *force, p, 0.0, 0.0, *[0] * 7, 63)
    yield mavlink.MAVLink_local_position_ned_message(ms, 1.0, 2.0, -0.5, 0.1, 0.2, 0.0)
    yield mavlink.MAVLink_servo_output_raw_message(us & 0xFFFFFFFF, 0, *outputs, *[0] * 11)
    yield mavlink.MAVLink_attitude_target_message(ms, 0, (1, 0, 0, 0), 0, 0, 0, 0.45)


def _distances(ms: int, *, lost: bool) -> Iterator[object]:
    """Down, and forward where the wall is out of reach now and then."""
    rest = (0, 0, (0, 0, 0, 0), 0)
    far = 900 if lost else 120
    yield mavlink.MAVLink_distance_sensor_message(ms, 5, 800, 50, 0, 0, 25, 1, *rest)
    yield mavlink.MAVLink_distance_sensor_message(ms, 5, 800, far, 0, 1, 2, 0, *rest)


def _escs(ms: int, count: int, *, px4: bool) -> Iterator[object | Wire]:
    rpm = (4000, 4010, 4020, 4030)
    if px4:
        volts = [16.0] * 4
        amperes = [5.0] * 4
        yield 291, ESC_STATUS.unpacker.pack(ms * 1000, *rpm, *volts, *amperes, 0)
        return
    constant = ([value] * 4 for value in (40, 1600, 500, 0))
    yield mavlink.MAVLink_esc_telemetry_1_to_4_message(*constant, rpm, [count] * 4)


def _power(ms: int, *, since_ms: int, px4: bool) -> Iterator[object | Wire]:
    volts = round(16_800 - since_ms / 100.0)
    cells = [volts, *[65535] * 9]
    yield mavlink.MAVLink_battery_status_message(0, 0, 0, 32767, cells, 2000, -1, -1, -1)
    yield mavlink.MAVLink_scaled_pressure_message(ms, 1000.0, 0.0, 2000)
    if px4:
        counts = [0] * 9
        celsius = [4100] * 4
        yield 290, ESC_INFO.unpacker.pack(ms * 1000, *counts, *celsius, 0, 4, 0, 15)


QUAD_MASS_KG = 3.0
QUAD_CT = 0.0140
QUAD_RADIUS_M = 0.14
"""Of the shipped quad.toml."""


def quad_flight(
    seconds: float = 40.0,
    start_ms: int = 40_000,
    arrival_us: int = EPOCH_US,
    system: int = 1,
    *,
    mass_kg: float = QUAD_MASS_KG,
    clip_m_s2: float = math.inf,
    gust_n: float = 0.0,
    parked: bool = False,
    imu: bool = True,
    rpm: bool = True,
    servo: bool = True,
    rate_hz: int = 25,
    nan_share: float = 0.0,
    landed: bool = False,
    kind: int = 2,
    seed: int = 1,
) -> list[tuple[int, bytes]]:
    """The shipped quadrotor in free air: climbs and sinks, turns slowly; thrust is exactly ``mass_kg``'s own.

    ``gust_n`` is a steady push to the north, ``parked`` stands still with its rotors stopped, ``landed`` lets the
    autopilot say that it stands on the ground, ``nan_share`` of the IMU samples and attitudes are NaN. Simulated.
    """
    flown = _fly_quad(seconds, rate_hz, mass_kg, gust_n, parked=parked)
    rng = np.random.default_rng(seed)
    noise = 0.1 * rng.standard_normal((len(flown.t), 3))
    force = np.clip(flown.force + noise, -clip_m_s2, clip_m_s2)
    rates = flown.rates + 0.002 * rng.standard_normal((len(flown.t), 3))
    lost = rng.random(len(flown.t)) < nan_share
    force[lost] = np.nan
    rates[lost] = np.nan
    measured = replace(flown, force=force, rates=rates)
    out: list[tuple[int, bytes]] = []
    for k, at in enumerate(flown.t.tolist()):
        boot_us = start_ms * 1000 + round(1e6 * at)
        boot_ms = start_ms + round(1e3 * at)
        messages = _quad_messages(measured, k, boot_ms, boot_us, imu=imu, servo=servo, rpm=rpm)
        if k % rate_hz == 0:
            messages.append(heartbeat(kind=kind))
            if landed:
                messages.append(mavlink.MAVLink_extended_sys_state_message(0, 1))
        arrival = arrival_us + round(at * 1e6) + 2000
        for i, message in enumerate(messages):
            out.append((arrival + i, frame(message, system, 1, (8 * k + i) % 256)))
    return out


@dataclass(frozen=True, kw_only=True)
class _Quad:
    """A flight of the shipped quadrotor; (n,), force and rates (n, 3)."""

    t: Array
    yaw: Array
    climb: Array
    force: Array
    rates: Array
    rpm: Array
    pwm: Array


def _fly_quad(
    seconds: float, rate_hz: int, mass_kg: float, gust_n: float, *, parked: bool
) -> _Quad:
    """Climbs and sinks, turns slowly."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    fly = 0.0 if parked else 1.0
    heave = fly * (0.8 * np.sin(0.9 * t) + 0.5 * np.sin(1.7 * t + 1.0))
    climb = fly * -(0.8 / 0.9 * np.cos(0.9 * t) + 0.5 / 1.7 * np.cos(1.7 * t + 1.0))
    yaw = np.angle(np.exp(1j * fly * 0.2 * t))
    lift = GRAVITY + heave
    thrust = fly * mass_kg * lift
    per_rpm2 = 4 * QUAD_CT * 1.225 * math.pi * QUAD_RADIUS_M**4 * (2 * math.pi / 60) ** 2
    north = gust_n / mass_kg
    pwm = 1100 + 800 * thrust / (2 * mass_kg * GRAVITY)
    return _Quad(
        t=t,
        yaw=yaw,
        climb=climb,
        force=np.stack([north * np.cos(yaw), -north * np.sin(yaw), -lift], axis=-1),
        rates=np.stack([0 * t, 0 * t, fly * 0.2 + 0 * t], axis=-1),
        rpm=np.sqrt(thrust / per_rpm2),
        pwm=np.full(len(t), 1000.0) if parked else pwm,
    )


def _quad_messages(
    flown: _Quad, k: int, ms: int, us: int, *, imu: bool, servo: bool, rpm: bool
) -> list[object]:
    """What the autopilot sends at one instant."""
    rates = flown.rates[k].tolist()
    climb = float(flown.climb[k])
    out: list[object] = [
        mavlink.MAVLink_attitude_message(ms, 0.0, 0.0, float(flown.yaw[k]), *rates),
        mavlink.MAVLink_local_position_ned_message(ms, 0.0, 0.0, -20.0, 0.0, 0.0, -climb),
    ]
    if imu:
        numbers = (*flown.force[k].tolist(), *rates)
        out.append(mavlink.MAVLink_highres_imu_message(us, *numbers, *[0] * 7, 63))
    if servo:
        pwm = [round(float(flown.pwm[k]))] * 4
        out.append(mavlink.MAVLink_servo_output_raw_message(us & 0xFFFFFFFF, 0, *pwm, *[0] * 12))
    if rpm:
        speeds = [round(float(flown.rpm[k]))] * 4
        constant = ([value] * 4 for value in (40, 1600, 500, 0))
        out.append(mavlink.MAVLink_esc_telemetry_1_to_4_message(*constant, speeds, [k % 65536] * 4))
    return out


def write_tlog(path, messages) -> bytes:
    data = b"".join(record(arrival, raw) for arrival, raw in messages)
    path.write_bytes(data)
    return data


# --- .BIN -------------------------------------------------------------------------------------------------------------

_BIN_CODES = {"c": "h", "C": "H", "e": "i", "E": "I", "M": "B", "n": "4s", "N": "16s", "Z": "64s"}


class BinWriter:
    """Dataflash messages: FMT for every kind, then rows."""

    def __init__(self) -> None:
        self._kinds: dict[str, tuple[int, str]] = {}
        self._out = bytearray()
        self._format(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")

    def _format(
        self, number: int, name: str, formats: str, columns: str, length: int | None = None
    ) -> None:
        codes = "".join(_BIN_CODES.get(f, f) for f in formats)
        length = 3 + struct.calcsize(f"<{codes}") if length is None else length
        self._out += b"\xa3\x95\x80" + struct.pack(
            "<BB4s16s64s", number, length, name.encode(), formats.encode(), columns.encode()
        )
        self._kinds[name] = (number, formats)

    def kind(self, name: str, formats: str, columns: str, *, length: int | None = None) -> None:
        """Declare a message, or declare it anew; ``length`` instead of what its fields make up."""
        number = self._kinds[name][0] if name in self._kinds else 129 + len(self._kinds)
        self._format(number, name, formats, columns, length)

    def undeclared(self, name: str, number: int, formats: str) -> None:
        """A message whose FMT is not written."""
        self._kinds[name] = (number, formats)

    def row(self, name: str, *values) -> None:
        number, formats = self._kinds[name]
        packed = [v.encode() if isinstance(v, str) else v for v in values]
        codes = "".join(_BIN_CODES.get(f, f) for f in formats)
        self._out += b"\xa3\x95" + bytes([number]) + struct.pack("<" + codes, *packed)

    def bytes(self) -> bytes:
        return bytes(self._out)


_HUNDREDTHS = "cCeE"


class TextWriter:
    """The same as text, as Mission Planner writes it: values in hundredths with two decimals."""

    def __init__(self, *, separator: str = ", ", end: str = "\r\n", decimal: str = ".") -> None:
        self._separator = separator
        self._end = end
        self._decimal = decimal
        self._kinds: dict[str, str] = {}
        self.lines: list[str] = []
        self._line("FMT", 128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")

    def _line(self, *fields) -> None:
        self.lines.append(self._separator.join(map(str, fields)))

    def kind(self, name: str, formats: str, columns: str) -> None:
        self._kinds[name] = formats
        self._line("FMT", 128 + len(self._kinds), 0, name, formats, columns)

    def row(self, name: str, *values) -> None:
        self._line(name, *map(self._shown, self._kinds[name], values))

    def _shown(self, format_: str, value) -> str:
        text = f"{value / 100.0:.2f}" if format_ in _HUNDREDTHS else str(value)
        return text if isinstance(value, str) else text.replace(".", self._decimal)

    def bytes(self) -> bytes:
        return self._end.join(self.lines).encode()


def bin_flight(
    seconds: float = 4.0,
    arming: bool = True,
    outputs: bool = True,
    *,
    writer: BinWriter | TextWriter | None = None,
) -> bytes:
    """A hover with one down range, four ESCs, armed from 1 s to 3 s in GUIDED; else only the end is said.

    Without ``outputs`` neither servo outputs nor speeds of ESCs are logged. ``writer``: to write it as text.
    """
    w = BinWriter() if writer is None else writer
    w.kind("ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    w.kind("IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    w.kind("XKF1", "QBffffff", "TimeUS,C,VN,VE,VD,PN,PE,PD")
    w.kind("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4")
    w.kind("RFND", "QBfBB", "TimeUS,Instance,Dist,Stat,Orient")
    w.kind("ESC", "QBfff", "TimeUS,Instance,RPM,Volt,Temp")
    w.kind("BAT", "QBff", "TimeUS,Instance,Volt,Curr")
    w.kind("ARM", "QB", "TimeUS,ArmState")
    w.kind("MODE", "QBB", "TimeUS,Mode,ModeNum")
    w.kind("PARM", "QNf", "TimeUS,Name,Value")
    w.row("PARM", 10_000_000, "GUID_OPTIONS", 8.0)
    w.row("MODE", 10_000_000, 4, 4)
    for k in range(round(seconds * 50)):
        us = 10_000_000 + 20_000 * k
        w.row("ATT", us, 0.0, 2.0, 0.0, -1.0, 90.0, 90.0)
        w.row("IMU", us, 0, 0.01, 0.02, 0.03, 0.1, 0.2, -9.8)
        w.row("XKF1", us, 0, 0.1, 0.2, 0.3, 1.0, 2.0, -0.5)
        w.row("XKF1", us, 1, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0)
        if outputs:
            w.row("RCOU", us, 1500, 1510, 1520, 1530)
        w.row("RFND", us, 0, 0.5, 3 if k == 7 else 4, 25)
        for esc in range(4 if outputs else 0):
            w.row("ESC", us, esc, 4000.0 + 10 * esc, 16.0, 40.0)
        w.row("BAT", us, 0, 16.0, 20.0)
        if k == 150 or (arming and k == 50):
            w.row("ARM", us, int(k == 50))
    return w.bytes()


# --- .ulg -------------------------------------------------------------------------------------------------------------

_ULG_CODES = dict(
    uint64_t="Q", float="f", uint8_t="B", int8_t="b", uint16_t="H", int32_t="i", bool="?"
)


class UlgWriter:
    """ULog: header, formats, parameters, subscriptions, data."""

    def __init__(self) -> None:
        self._out = bytearray(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000))
        self._message("B", bytes(40))
        self._topics: dict[str, tuple[int, str]] = {}
        self._definitions: list[tuple[str, list[tuple[str, str]]]] = []

    def _message(self, kind: str, payload: bytes) -> None:
        self._out += struct.pack("<HB", len(payload), ord(kind)) + payload

    def topic(self, name: str, *fields: tuple[str, str]) -> None:
        """A topic; ``NAME:1`` is its second instance."""
        fields = (("uint64_t", "timestamp"), *fields)
        text = f"{name.partition(':')[0]}:" + "".join(f"{kind} {field};" for kind, field in fields)
        self._message("F", text.encode())
        self._definitions.append((name, list(fields)))

    def parameter(self, name: str, value: float) -> None:
        key = f"float {name}".encode()
        self._message("P", bytes([len(key)]) + key + struct.pack("<f", value))

    def subscribe(self) -> None:
        for number, (name, fields) in enumerate(self._definitions):
            base, _, instance = name.partition(":")
            self._message("A", struct.pack("<BH", int(instance or 0), number) + base.encode())
            codes = "".join(self._code(kind) for kind, _ in fields)
            self._topics[name] = (number, codes)

    @staticmethod
    def _code(kind: str) -> str:
        base, _, count = kind.partition("[")
        return f"{count.rstrip(']')}{_ULG_CODES[base]}" if count else _ULG_CODES[base]

    def row(self, name: str, t_us: int, *values) -> None:
        number, codes = self._topics[name]
        self._message("D", struct.pack("<H", number) + struct.pack("<" + codes, t_us, *values))

    def bytes(self) -> bytes:
        return bytes(self._out)


def ulg_flight(seconds: float = 4.0) -> bytes:
    """A hover in OFFBOARD with one forward range whose quality is unknown, and two ESCs."""
    w = UlgWriter()
    w.topic("vehicle_attitude", ("float[4]", "q"))
    w.topic("vehicle_angular_velocity", ("float[3]", "xyz"))
    w.topic("sensor_combined", ("float[3]", "gyro_rad"), ("float[3]", "accelerometer_m_s2"))
    w.topic(
        "vehicle_local_position", *[("float", n) for n in ("x", "y", "z", "vx", "vy", "vz")],
        *[("bool", n) for n in ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid")],
    )  # fmt: skip
    w.topic(
        "distance_sensor", ("float", "min_distance"), ("float", "max_distance"), ("float", "current_distance"),
        ("float", "variance"), ("float[4]", "q"), ("int8_t", "signal_quality"), ("uint8_t", "orientation"),
    )  # fmt: skip
    w.topic(
        "vehicle_status",
        *[("uint8_t", n) for n in ("arming_state", "nav_state", "system_type", "system_id")],
    )
    w.topic("battery_status", ("float", "voltage_v"), ("float", "current_a"))
    w.topic("actuator_outputs", ("float[16]", "output"))
    w.parameter("MPC_THR_HOVER", 0.5)
    w.subscribe()
    for k in range(round(seconds * 50)):
        us = 20_000_000 + 20_000 * k
        w.row("vehicle_attitude", us, 1.0, 0.0, 0.0, 0.0)
        w.row("vehicle_angular_velocity", us, 0.1, 0.2, 0.3)
        w.row("sensor_combined", us, 0.1, 0.2, 0.3, 0.0, 0.0, -9.8)
        w.row("vehicle_local_position", us, 1.0, 2.0, -0.5, 0.1, 0.2, 0.3, True, True, k != 5, True)
        w.row("distance_sensor", us, 0.1, 10.0, 1.5, 0.0004, 0, 0, 0, 0, 0 if k == 9 else -1, 0)
        w.row("vehicle_status", us, 2 if k > 10 else 1, 14, 2, 3)
        w.row("battery_status", us, 16.0, -1.0)
        w.row("actuator_outputs", us, *range(1000, 1016))
    return w.bytes()


def write_data_set(path, data: DataSet) -> None:
    """In the format of docs/formats.md, eight digits."""
    table = np.column_stack([data.h, data.d, data.rpm, data.wrench])
    np.savetxt(path, table, fmt="%.8g", delimiter=",", header=HEADER, comments="")
