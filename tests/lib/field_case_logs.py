"""Logs of one small flight with one oddity each, as public threads report them: docs/lab/field-logs.md.

Every function takes the path to write. A base log of each format is what its firmware writes by default; an oddity
changes rows of it. Nothing is copied from anybody's log.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from hover_flight import EXPO, HEXA_X, MASS_KG, SECONDS, Flight, fly
from log_writers import EPOCH_US, BinWriter, UlgWriter, frame, heartbeat, write_tlog

from companion.mavlink.dialect import mavlink
from companion.mavlink.esc_messages import ESC_STATUS
from companion.mavlink.wire_frames import pack
from models.common.frames import GRAVITY

IMU_HZ = 50
SLOW_HZ = 25
VOLTS = (15.5, 16.5)
"""What the pack reads in this flight."""
DRAG = ("rotor_drag", "body_drag", "vertical_inflow")
"""Names that a flight of this size cannot exclude."""
CORNERS = (1, 2, 3, 4)


@dataclass(frozen=True, kw_only=True)
class Expected:
    """What somebody who knows the vehicle expects. Empty and None: not asked."""

    text: str
    """In one line."""
    source: str = ""
    """Where such a log was reported."""
    judged_s: float = 15.0
    """At least so much of the flight is judged. 0: a refusal will do."""
    judged_most_s: float = SECONDS
    frame: str = ""
    rotors: tuple[int, ...] = ()
    volts: tuple[float, float] | None = None
    """Every reading of the battery lies between."""
    speed_m_s: float | None = None
    """The vehicle is never said to be faster."""
    names: tuple[str, ...] | None = DRAG
    """Effects that may be named; None: any."""
    says: str = ""
    """A pattern that must stand in the answers of ``info`` or ``diagnose``."""
    never: tuple[str, ...] = ("did not fly", "lost to: no height", "tandem coaxial")
    """What must stand in none."""
    refused: str = ""
    """A pattern: a refusal with this reason is right, too."""


# --- .BIN -------------------------------------------------------------------------------------------------------------

Row = tuple[float, str, tuple]
"""Time [s since boot], message, values after the stamp."""

BOOT_S = 100.0
BIN_FORMATS = {
    "IMU": ("QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "ATT": ("Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
    "XKF1": ("QBffffff", "TimeUS,C,VN,VE,VD,PN,PE,PD"),
    "XKF4": ("QBb", "TimeUS,C,PI"),
    "CTUN": ("Qfff", "TimeUS,ThO,Alt,SAlt"),
    "RCOU": ("Q" + 14 * "H", "TimeUS," + ",".join(f"C{k}" for k in range(1, 15))),
    "ESC": ("QBfff", "TimeUS,Instance,RPM,Volt,Temp"),
    "BAT": ("QBff", "TimeUS,Inst,Volt,Curr"),
    "BARO": ("QBff", "TimeUS,I,Alt,Press"),
    "MODE": ("QBB", "TimeUS,Mode,ModeNum"),
    "EV": ("QB", "TimeUS,Id"),
    "MSG": ("QZ", "TimeUS,Message"),
    "PARM": ("QNf", "TimeUS,Name,Value"),
}
QUAD_PARAMETERS = {
    "FRAME_CLASS": 1.0,
    "FRAME_TYPE": 1.0,
    "SERVO1_FUNCTION": 33.0,
    "SERVO2_FUNCTION": 34.0,
    "SERVO3_FUNCTION": 35.0,
    "SERVO4_FUNCTION": 36.0,
    "MOT_PWM_MIN": 1000.0,
    "MOT_PWM_MAX": 2000.0,
    "MOT_THST_EXPO": 0.65,
    "MOT_SPIN_MIN": 0.15,
    "MOT_SPIN_MAX": 0.95,
    "MOT_THST_HOVER": 0.52,
    "BATT_MONITOR": 4.0,
    "GUID_OPTIONS": 8.0,
}


@dataclass(frozen=True)
class BinLog:
    """A dataflash log before it is written."""

    rows: tuple[Row, ...]
    formats: dict[str, tuple[str, str]] = field(default_factory=lambda: dict(BIN_FORMATS))
    parameters: dict[str, float] = field(default_factory=lambda: dict(QUAD_PARAMETERS))

    def changed(self, change: Callable[[Row], Row | None]) -> BinLog:
        """The log with every row changed; None leaves it out."""
        rows = (change(row) for row in self.rows)
        return replace(self, rows=tuple(row for row in rows if row is not None))

    def plus(self, rows: list[Row]) -> BinLog:
        """The log with more rows, each at its time."""
        together = sorted([*self.rows, *rows], key=lambda row: row[0])
        return replace(self, rows=tuple(together))

    def write(self, path: Path) -> None:
        """As ArduPilot does: formats, parameters, rows."""
        writer = BinWriter()
        for name, (codes, columns) in self.formats.items():
            writer.kind(name, codes, columns)
        start = round(BOOT_S * 1e6)
        writer.row("MSG", start, "ArduCopter V4.5.7 (0badf00d)")
        for name, value in self.parameters.items():
            writer.row("PARM", start, name, value)
        for t, name, values in self.rows:
            writer.row(name, round(t * 1e6), *values)
        path.write_bytes(writer.bytes())


def pulses(flight: Flight, t: float) -> list[int]:
    """Of each motor, 1000 to 2000 us."""
    command = flight.at(flight.command, t)
    return [round(1000.0 + 1000.0 * float(u)) for u in command]


def bin_log(flight: Flight | None = None) -> BinLog:
    """What ArduCopter 4.5 writes of a quadcopter."""
    flight = flight or fly()
    rows: list[Row] = [(BOOT_S, "MODE", (5, 5)), (BOOT_S + 1.0, "EV", (10,))]
    for t, name, values in _bin_rows(flight):
        rows.append((BOOT_S + t, name, values))
    rows.append((BOOT_S + SECONDS - 0.5, "EV", (11,)))
    return BinLog(tuple(sorted(rows, key=lambda row: row[0])))


def _bin_rows(flight: Flight) -> Iterator[Row]:
    noise = np.random.default_rng(1)
    for t in _times(IMU_HZ):
        yield t, "IMU", (0, *measured_imu(flight, t, noise))
    for t in _times(SLOW_HZ):
        place = flight.at(flight.position, t).tolist()
        speed = flight.at(flight.velocity, t).tolist()
        roll, pitch, yaw = np.degrees(flight.at(flight.euler, t)).tolist()
        outputs = pulses(flight, t)
        throttle = float(flight.at(flight.command, t).mean())
        yield t, "ATT", (roll, roll, pitch, pitch, yaw % 360.0, yaw % 360.0)
        yield t, "XKF1", (0, *speed, *place)
        yield t, "CTUN", (throttle, -place[2], 0.0)
        yield t, "RCOU", (*outputs, *[0] * 10)
        for motor, rpm in enumerate(flight.at(flight.rpm, t).tolist()):
            yield t, "ESC", (motor, rpm, 16.0, 40.0)
    for t in _times(5):
        height = -float(flight.at(flight.position, t)[2])
        volts = float(flight.at(flight.volts, t))
        yield t, "BAT", (0, volts, float(flight.at(flight.amps, t)))
        yield t, "BARO", (0, height, 101_325.0 - 12.0 * height)
        yield t, "XKF4", (0, 0)


def measured_imu(flight: Flight, t: float, noise: np.random.Generator) -> list[float]:
    """Gyro and accelerometer, with noise."""
    rates = flight.at(flight.rates, t) + 0.004 * noise.standard_normal(3)
    force = flight.at(flight.force, t) + 0.06 * noise.standard_normal(3)
    return [*rates.tolist(), *force.tolist()]


def _times(rate_hz: int) -> list[float]:
    return [k / rate_hz for k in range(round(SECONDS * rate_hz))]


def lane_switch(path: Path) -> None:
    """Estimator 0 runs away in flight; the autopilot flies on with estimator 1."""
    switch = BOOT_S + 15.0

    def away(row: Row) -> Row:
        t, name, values = row
        if name == "XKF4" and t >= switch:
            return t, name, (0, 1)
        if name != "XKF1" or t < switch:
            return row
        error = 4.0 * (t - switch)
        core, north, east, down, *place = values
        return t, name, (core, north + 4.0, east, down, place[0] + error, *place[1:])

    log = bin_log()
    good = [(t, n, (1, *v[1:])) for t, n, v in log.rows if n == "XKF1"]
    log.changed(away).plus(good).write(path)


def replayed_cores(path: Path) -> None:
    """A log of Replay: estimators 100 and 101 are what a changed program makes of the same flight."""

    def other(row: Row) -> Row:
        t, name, values = row
        return t, name, (100, *[3.0 * v for v in values[1:]])

    log = bin_log()
    log.plus([other(row) for row in log.rows if row[1] == "XKF1"]).write(path)


def _motors_from(first: int, log: BinLog) -> BinLog:
    """The same flight with its motors on outputs ``first`` to ``first + 3``."""
    functions = {f"SERVO{k}_FUNCTION": 0.0 for k in range(1, 5)}
    functions |= {f"SERVO{first + k}_FUNCTION": 33.0 + k for k in range(4)}
    return replace(log, parameters=log.parameters | functions)


def esc_numbers_from_nine(path: Path) -> None:
    """Motors on outputs 9 to 12; the ESCs are numbered as the outputs, as since 4.5."""

    def moved(row: Row) -> Row:
        t, name, values = row
        if name == "RCOU":
            return t, name, (*[0] * 8, *values[:4], 0, 0)
        if name == "ESC":
            return t, name, (values[0] + 8, *values[1:])
        return row

    _motors_from(9, bin_log().changed(moved)).write(path)


def esc_numbers_from_one(path: Path) -> None:
    """Motors on outputs 9 to 12; the ESCs are numbered from the first, as before 4.5."""

    def moved(row: Row) -> Row:
        t, name, values = row
        if name == "RCOU":
            return t, name, (*[0] * 8, *values[:4], 0, 0)
        return row

    _motors_from(9, bin_log().changed(moved)).write(path)


def motors_from_17(path: Path) -> None:
    """Motors on outputs 17 to 20: half of them in RCO2, half in RCO3. No ESC is telemetered."""
    log = bin_log()
    rows: list[Row] = []
    for t, name, values in log.rows:
        if name == "ESC":
            continue
        if name != "RCOU":
            rows.append((t, name, values))
            continue
        rows.append((t, name, (0,) * 14))
        rows.append((t, "RCO2", (0, 0, *values[:2])))
        rows.append((t, "RCO3", (*values[2:4], *[0] * 12)))
    second = ",".join(f"C{k}" for k in range(15, 19))
    third = ",".join(f"C{k}" for k in range(19, 33))
    more = {"RCO2": ("QHHHH", f"TimeUS,{second}"), "RCO3": ("Q" + 14 * "H", f"TimeUS,{third}")}
    changed = replace(log, rows=tuple(rows), formats=log.formats | more)
    _motors_from(17, changed).write(path)


def corrupt_stamp(path: Path) -> None:
    """Three messages in flight bear a stamp of 133 000 years."""
    broken = {BOOT_S + 10.0, BOOT_S + 12.0, BOOT_S + 14.0}

    def stamped(row: Row) -> Row:
        t, name, values = row
        return (4.213e12, name, values) if t in broken and name in ("ATT", "RCOU") else row

    bin_log().changed(stamped).write(path)


def imu_frozen(path: Path) -> None:
    """IMU 0 repeats one reading all flight; IMU 1 is good, and the estimator uses it."""

    def frozen(row: Row) -> Row:
        t, name, _ = row
        still = (0, 0.001, -0.002, 0.0, 0.05, 0.1, -9.8)
        if name == "IMU":
            return t, name, still
        return (t, name, (1, 1)) if name == "XKF4" else row

    log = bin_log()
    good = [(t, n, (1, *v[1:])) for t, n, v in log.rows if n == "IMU"]
    lane = [(t, n, (1, *v[1:])) for t, n, v in log.rows if n == "XKF1"]
    log.changed(frozen).plus(good).plus(lane).write(path)


def range_unplugged(path: Path) -> None:
    """A rangefinder that is unplugged: its last reading is repeated, and no column says how good it is."""
    log = bin_log()
    rows = [(BOOT_S + t, "RFND", (0.21, 25, 0.0, 0)) for t in _times(SLOW_HZ)]
    old = {"RFND": ("QfBfB", "TimeUS,Dist1,Orient1,Dist2,Orient2")}
    replace(log, formats=log.formats | old).plus(rows).write(path)


def range_says_no_data(path: Path) -> None:
    """The same with a status column: 1, no data."""
    log = bin_log()
    rows = [(BOOT_S + t, "RFND", (0, 0.21, 1, 25)) for t in _times(SLOW_HZ)]
    new = {"RFND": ("QBfBB", "TimeUS,Instance,Dist,Stat,Orient")}
    replace(log, formats=log.formats | new).plus(rows).write(path)


def parameter_in_flight(path: Path) -> None:
    """After 20 s somebody takes motor 1 off its output: what a parameter is at the end, it was not in flight."""
    changed = [(BOOT_S + 26.0, "PARM", ("SERVO1_FUNCTION", 1.0))]
    bin_log().plus(changed).write(path)


def no_battery_monitor(path: Path) -> None:
    """BATT_MONITOR 0, and yet 0 V is logged five times a second."""

    def empty(row: Row) -> Row:
        t, name, _ = row
        return (t, name, (0, 0.0, 0.0)) if name == "BAT" else row

    log = bin_log().changed(empty)
    replace(log, parameters=log.parameters | {"BATT_MONITOR": 0.0}).write(path)


def unused_outputs_hold_anything(path: Path) -> None:
    """Before SERVOn_FUNCTION: outputs 5 to 8 are not connected, and hold whatever was in memory. No ESC telemetry."""

    def filled(row: Row) -> Row | None:
        t, name, values = row
        if name == "ESC":
            return None
        if name != "RCOU":
            return row
        return t, name, (*values[:4], 52_328, 19_517, 5_109, 53_960, *values[8:])

    log = bin_log().changed(filled)
    old = {name: value for name, value in log.parameters.items() if name.startswith("MOT_")}
    replace(log, parameters=old | {"FRAME": 1.0}).write(path)


def simulator_hovers_still(path: Path) -> None:
    """A simulator's hover: 10 m up for 20 s, nothing moves at all, and then the log ends."""
    aloft = fly()
    rise = 10.0 * np.clip((aloft.t - 3.0) / 3.0, 0.0, 1.0)
    climb = np.where((aloft.t > 3.0) & (aloft.t < 6.0), 10.0 / 3.0, 0.0)
    zero = np.zeros_like(aloft.rates)
    still = replace(
        aloft,
        quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (len(rise), 1)),
        euler=zero,
        rates=zero,
        position=np.column_stack([zero[:, :2], -rise]),
        velocity=np.column_stack([zero[:, :2], -climb]),
        force=np.tile([0.0, 0.0, -GRAVITY], (len(rise), 1)),
        thrust=np.where(aloft.t[:, None] < 3.0, 0.05, MASS_KG * GRAVITY / 4.0 + 0.0 * aloft.thrust),
    )
    bin_log(still).write(path)


def estimator_falls_on_the_bench(path: Path) -> None:
    """Full throttle without propellers for 20 s; the estimator says 2 m/s down, and the same place."""

    def held(row: Row) -> Row | None:
        t, name, values = row
        if name == "ESC":
            return None
        turns = 3.0 <= t - BOOT_S < 24.0
        if name == "RCOU":
            full = 1950 if turns else 1000
            return t, name, (*[full] * 4, *values[4:])
        if name == "XKF1":
            return t, name, (0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0)
        if name == "ATT":
            return t, name, (0.0, 0.3, 0.0, -0.2, 0.0, 10.0)
        if name == "IMU":
            return t, name, (0, *values[1:4], 0.1, 0.0, -9.7)
        if name == "BARO":
            return t, name, (0, 0.1, 101_324.0)
        return row

    bin_log().changed(held).write(path)


# --- .ulg -------------------------------------------------------------------------------------------------------------

QUAD_PLACES = {0: (0.16, 0.16), 1: (-0.16, -0.16), 2: (0.16, -0.16), 3: (-0.16, 0.16)}
ULG_FIELDS = {
    "vehicle_attitude": (("float[4]", "q"),),
    "vehicle_angular_velocity": (("float[3]", "xyz"),),
    "sensor_combined": (("float[3]", "gyro_rad"), ("float[3]", "accelerometer_m_s2")),
    "vehicle_local_position": (
        *[("float", n) for n in ("x", "y", "z", "vx", "vy", "vz")],
        *[("bool", n) for n in ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid")],
    ),
    "vehicle_status": tuple(
        ("uint8_t", n) for n in ("arming_state", "nav_state", "system_type", "system_id")
    ),
    "vehicle_land_detected": (("bool", "landed"),),
    "battery_status": (("float", "voltage_v"), ("float", "current_a"), ("bool", "connected")),
    "vehicle_air_data": (("float", "baro_pressure_pa"),),
    "actuator_outputs": (("int32_t", "noutputs"), ("float[16]", "output")),
}


def px4_parameters() -> dict[str, float]:
    """Of a quadcopter with its motors on MAIN 1 to 4."""
    values = {"MAV_TYPE": 2.0, "CA_AIRFRAME": 0.0, "CA_ROTOR_COUNT": 4.0, "THR_MDL_FAC": 0.65}
    for rotor, (ahead, right) in QUAD_PLACES.items():
        values[f"CA_ROTOR{rotor}_PX"] = ahead
        values[f"CA_ROTOR{rotor}_PY"] = right
        values[f"CA_ROTOR{rotor}_KM"] = 0.05 if rotor < 2 else -0.05
        values[f"PWM_MAIN_FUNC{rotor + 1}"] = 101.0 + rotor
    return values


@dataclass(frozen=True)
class UlgLog:
    """A ULog before it is written. The names of topics may end in ``:INSTANCE``."""

    rows: tuple[Row, ...]
    fields: dict[str, tuple[tuple[str, str], ...]]
    parameters: dict[str, float]

    def write(self, path: Path) -> None:
        """As PX4 does: formats, parameters, subscriptions, rows."""
        writer = UlgWriter()
        for name, fields in self.fields.items():
            writer.topic(name, *fields)
        for name, value in self.parameters.items():
            writer.parameter(name, value)
        writer.subscribe()
        for t, name, values in self.rows:
            writer.row(name, round(t * 1e6), *values)
        path.write_bytes(writer.bytes())


def px4_pulses(flight: Flight, t: float) -> list[float]:
    """Of each motor, 1000 to 2000 us."""
    command = flight.at(flight.command, t)
    return [round(1000.0 + 1000.0 * float(u)) for u in command]


def ulg_log(flight: Flight | None = None) -> UlgLog:
    """What PX4 1.14 writes of a quadcopter."""
    rows = sorted(_ulg_rows(flight or fly()), key=lambda row: row[0])
    late = tuple((BOOT_S + t, name, values) for t, name, values in rows)
    return UlgLog(late, dict(ULG_FIELDS), px4_parameters())


def _ulg_rows(flight: Flight) -> Iterator[Row]:
    noise = np.random.default_rng(2)
    for t in _times(IMU_HZ):
        yield t, "sensor_combined", tuple(measured_imu(flight, t, noise))
    for t in _times(SLOW_HZ):
        place = flight.at(flight.position, t).tolist()
        speed = flight.at(flight.velocity, t).tolist()
        yield t, "vehicle_attitude", tuple(flight.at(flight.quaternion, t).tolist())
        yield t, "vehicle_angular_velocity", tuple(flight.at(flight.rates, t).tolist())
        yield t, "vehicle_local_position", (*place, *speed, *[True] * 4)
        yield t, "actuator_outputs", (8, *px4_pulses(flight, t), *[0.0] * 12)
    for t in _times(5):
        armed = 2 if 1.0 <= t < SECONDS - 0.5 else 1
        height = -float(flight.at(flight.position, t)[2])
        volts = float(flight.at(flight.volts, t))
        yield t, "vehicle_status", (armed, 2, 2, 1)
        yield t, "vehicle_land_detected", (not flight.airborne(t),)
        yield t, "battery_status", (volts, float(flight.at(flight.amps, t)), True)
        yield t, "vehicle_air_data", (101_325.0 - 12.0 * height,)


def _outputs_elsewhere(
    log: UlgLog, instance: int, others: dict[int, list[float]], full: float
) -> UlgLog:
    """Motors in ``actuator_outputs:INSTANCE``, where 1 is ``full``; the other instances hold still values."""
    rows: list[Row] = []
    for t, name, values in log.rows:
        if name != "actuator_outputs":
            rows.append((t, name, values))
            continue
        for number, still in others.items():
            rows.append((t, f"actuator_outputs:{number}", (8, *still, *[0.0] * (16 - len(still)))))
        moving = [full * (v - 1000.0) / 1000.0 if full != 1.0 else v for v in values[1:5]]
        rows.append((t, f"actuator_outputs:{instance}", (4, *moving, *[0.0] * 12)))
    fields = {n: f for n, f in log.fields.items() if n != "actuator_outputs"}
    for number in sorted([*others, instance]):
        fields[f"actuator_outputs:{number}"] = ULG_FIELDS["actuator_outputs"]
    return UlgLog(tuple(rows), fields, log.parameters)


def can_is_first(path: Path) -> None:
    """CAN takes instances 0 and 1 and drives nothing; MAIN idles in 2, and AUX 1 to 4, in 3, drive the motors."""
    log = ulg_log()
    functions = {f"PWM_MAIN_FUNC{k}": 0.0 for k in CORNERS}
    functions |= {f"PWM_AUX_FUNC{k}": 100.0 + k for k in CORNERS}
    log = replace(log, parameters=log.parameters | functions)
    still = {0: [0.0] * 8, 1: [0.0] * 8, 2: [900.0] * 8}
    _outputs_elsewhere(log, 3, still, 1.0).write(path)


def can_drives_motors(path: Path) -> None:
    """Motors on CAN, in instance 2, as 0 to 8191; MAIN idles at 900, AUX holds a camera at 1500."""
    log = ulg_log()
    functions = {f"PWM_MAIN_FUNC{k}": 0.0 for k in CORNERS}
    functions |= {f"UAVCAN_EC_FUNC{k}": 100.0 + k for k in CORNERS}
    functions |= {"UAVCAN_ENABLE": 3.0, "PWM_AUX_FUNC1": 402.0}
    log = replace(log, parameters=log.parameters | functions)
    still = {0: [900.0] * 8, 1: [1500.0] * 2}
    _outputs_elsewhere(log, 2, still, 8191.0).write(path)


def only_actuator_motors(path: Path) -> None:
    """No outputs of a driver are logged, only what the allocation asks of each motor, 0 to 1, and NaN for none."""
    log = ulg_log()
    rows: list[Row] = []
    for t, name, values in log.rows:
        if name != "actuator_outputs":
            rows.append((t, name, values))
            continue
        outputs = [(v - 1000.0) / 1000.0 for v in values[1:5]]
        # The allocation asks for thrust; the driver makes the output of it by THR_MDL_FAC.
        asked = [(1.0 - EXPO) * u + EXPO * u * u for u in outputs]
        rows.append((t, "actuator_motors", (*asked, *[math.nan] * 8)))
    fields = {n: f for n, f in log.fields.items() if n != "actuator_outputs"}
    fields["actuator_motors"] = (("float[12]", "control"),)
    UlgLog(tuple(rows), fields, log.parameters).write(path)


def indoors(path: Path) -> None:
    """No position and no velocity over ground: zeros, said to be invalid. Height is good."""
    log = ulg_log()
    rows: list[Row] = []
    for t, name, values in log.rows:
        if name == "vehicle_local_position":
            _, _, z, _, _, vz, *_ = values
            values = (0.0, 0.0, z, 0.0, 0.0, vz, False, True, False, True)
        rows.append((t, name, values))
    replace(log, rows=tuple(rows)).write(path)


def esc_one_stuck(path: Path) -> None:
    """ESC 1 reports 1000 rpm all flight; the others are right."""
    flight = fly()
    log = ulg_log(flight)
    rows: list[Row] = list(log.rows)
    for t in _times(SLOW_HZ):
        speeds = [round(v) for v in flight.at(flight.rpm, t).tolist()]
        rows.append((BOOT_S + t, "esc_status", (4, 1000, *speeds[1:])))
    speed_fields = [("int32_t", f"esc[{k}].esc_rpm") for k in range(4)]
    fields = log.fields | {"esc_status": (("uint8_t", "esc_count"), *speed_fields)}
    ordered = tuple(sorted(rows, key=lambda row: row[0]))
    UlgLog(ordered, fields, log.parameters).write(path)


# --- .tlog ------------------------------------------------------------------------------------------------------------

Sent = tuple[float, int, object]
"""Time [s since boot], component, message or packed frame."""
GIMBAL = 154
ADSB = 156


def tlog_messages(
    flight: Flight | None = None, parameters: dict[str, float] | None = None
) -> list[Sent]:
    """What ArduCopter 4.5 sends a ground station of a quadcopter. No ESC is telemetered."""
    flight = flight or fly()
    values = QUAD_PARAMETERS if parameters is None else parameters
    sent: list[Sent] = []
    for number, (name, value) in enumerate(values.items()):
        packed = mavlink.MAVLink_param_value_message(
            name.encode(), value, 9, len(QUAD_PARAMETERS), number
        )
        sent.append((BOOT_S, 1, packed))
    for t, message in _tlog_rows(flight):
        sent.append((BOOT_S + t, 1, message))
    return sorted(sent, key=lambda row: row[0])


def _tlog_rows(flight: Flight, *, px4: bool = False) -> Iterator[tuple[float, object]]:
    noise = np.random.default_rng(3)
    for t in _times(IMU_HZ):
        ms = stamp_ms(t)
        gyro_force = measured_imu(flight, t, noise)
        numbers = (*gyro_force[3:], *gyro_force[:3])
        yield t, mavlink.MAVLink_highres_imu_message(1000 * ms, *numbers, *[0] * 7, 63)
    for t in _times(SLOW_HZ):
        ms = stamp_ms(t)
        angles = flight.at(flight.euler, t).tolist()
        rates = flight.at(flight.rates, t).tolist()
        place = flight.at(flight.position, t).tolist()
        speed = flight.at(flight.velocity, t).tolist()
        outputs = px4_pulses(flight, t) if px4 else pulses(flight, t)
        unused = [0] * (16 - len(outputs))
        yield t, mavlink.MAVLink_attitude_message(ms, *angles, *rates)
        yield t, mavlink.MAVLink_local_position_ned_message(ms, *place, *speed)
        yield t, mavlink.MAVLink_servo_output_raw_message(1000 * ms, 0, *outputs, *unused)
    for t in _times(2):
        ms = stamp_ms(t)
        armed = 1.0 <= t < SECONDS - 0.5
        height = -float(flight.at(flight.position, t)[2])
        kind = 13 if len(flight.thrust[0]) == 6 else 2
        yield t, heartbeat(armed, 12 if px4 else 3, 3 << 16 if px4 else 5, kind)
        yield t, mavlink.MAVLink_extended_sys_state_message(0, 2 if flight.airborne(t) else 1)
        yield t, mavlink.MAVLink_scaled_pressure_message(ms, 1013.25 - 0.12 * height, 0.0, 2500)
        yield t, battery(float(flight.at(flight.volts, t)), 0)


def stamp_ms(t: float) -> int:
    """``time_boot_ms`` at ``t`` s of the flight."""
    return round(1000.0 * (BOOT_S + t))


def battery(volts: float, number: int) -> object:
    """BATTERY_STATUS of a pack without cells of its own."""
    cells = [round(1000.0 * volts), *[65535] * 9]
    return mavlink.MAVLink_battery_status_message(number, 0, 0, 32767, cells, 1500, -1, -1, 80)


def write_sent(path: Path, sent: list[Sent], system: int = 1) -> None:
    """Each message 2 ms after it was sent."""
    frames: list[tuple[int, bytes]] = []
    for number, (t, component, message) in enumerate(sorted(sent, key=lambda row: row[0])):
        raw = message
        if not isinstance(message, bytes):
            raw = frame(message, system, component, number % 256)
        frames.append((EPOCH_US + round(1e6 * (t - BOOT_S)) + 2000, raw))
    write_tlog(path, frames)


def gimbal_and_adsb(path: Path) -> None:
    """A gimbal with an attitude and an IMU of its own, and an ADS-B receiver, say that they are alive as system 1."""
    sent = tlog_messages()
    for t in _times(10):
        ms = stamp_ms(t)
        swung = mavlink.MAVLink_attitude_message(ms, 0.5, -1.2, 2.0, 0.0, 0.0, 0.0)
        shaken = mavlink.MAVLink_raw_imu_message(1000 * ms, 700, 0, -200, 0, 0, 0, 0, 0, 0)
        sent += [(BOOT_S + t, GIMBAL, swung), (BOOT_S + t, GIMBAL, shaken)]
    for t in _times(1):
        alive = mavlink.MAVLink_heartbeat_message(26, 8, 0, 0, 4, 3)
        near = mavlink.MAVLink_heartbeat_message(27, 8, 0, 0, 4, 3)
        sent += [(BOOT_S + t, GIMBAL, alive), (BOOT_S + t, ADSB, near)]
    write_sent(path, sent)


def second_battery_without_cells(path: Path) -> None:
    """A second monitor that knows no voltage sends 65535 twice as often as the pack its own."""
    cells = [65535] * 10
    empty = mavlink.MAVLink_battery_status_message(1, 0, 0, 32767, cells, -1, -1, -1, -1)
    write_sent(path, tlog_messages() + [(BOOT_S + t, 1, empty) for t in _times(4)])


def esc_batches(path: Path) -> None:
    """A hexacopter on PX4: the second message of ESC speeds repeats those of the first ESCs."""
    flight = fly(HEXA_X)
    sent: list[Sent] = [(BOOT_S + t, 1, message) for t, message in _tlog_rows(flight, px4=True)]
    for t in _times(10):
        speeds = [round(v) for v in flight.at(flight.rpm, t).tolist()]
        for index in (0, 4):
            status = ESC_STATUS.unpacker.pack(
                1000 * stamp_ms(t), *speeds[:4], *[16.0] * 4, *[4.0] * 4, index
            )
            sent.append((BOOT_S + t, 1, pack(291, status, 1, 1, 0)))
    write_sent(path, sent)


def watchdog_reset(path: Path) -> None:
    """After 22 s in the air the autopilot restarts: its clock begins anew, its motors stop, it falls."""
    end = BOOT_S + 22.0
    sent = [row for row in tlog_messages() if row[0] < end]
    for k in range(75):
        t = k / 25.0
        ms = 2000 + round(1000.0 * t)
        tumble = mavlink.MAVLink_attitude_message(ms, min(t, 2.0), 0.3, 0.0, 1.0, 0.0, 0.0)
        falls = mavlink.MAVLink_highres_imu_message(
            1000 * ms, 0.1, 0.0, -0.5, 1.0, 0.0, 0.0, *[0] * 7, 63
        )
        stopped = mavlink.MAVLink_servo_output_raw_message(1000 * ms, 0, *[1000] * 4, *[0] * 12)
        sent += [(end + 1.0 + t, 1, message) for message in (tumble, falls, stopped)]
        if k % 25 == 0:
            sent.append((end + 1.0 + t, 1, heartbeat(False, 3, 5)))
    write_sent(path, sent)


def speed_spikes(path: Path) -> None:
    """ESCs that now and then report 38 000 rpm, one at a time."""
    flight = fly()
    sent = tlog_messages(flight)
    for k, t in enumerate(_times(10)):
        speeds = [round(v) for v in flight.at(flight.rpm, t).tolist()]
        if k % 17 == 0:
            speeds[k % 4] = 38_000
        telemetry = ([40] * 4, [1600] * 4, [400] * 4, [0] * 4, speeds, [k] * 4)
        sent.append((BOOT_S + t, 1, mavlink.MAVLink_esc_telemetry_1_to_4_message(*telemetry)))
    write_sent(path, sent)


def parameters_cut_short(path: Path) -> None:
    """The download of parameters stopped half-way: SERVO1_FUNCTION came, those of the other motors did not."""
    lost = {"SERVO2_FUNCTION", "SERVO3_FUNCTION", "SERVO4_FUNCTION"}
    came = {name: value for name, value in QUAD_PARAMETERS.items() if name not in lost}
    write_sent(path, tlog_messages(parameters=came))


def system_zero(path: Path) -> None:
    """A simulated vehicle whose SYSID_THISMAV was never set: it sends as system 0."""
    write_sent(path, tlog_messages(), system=0)


# --- The cases --------------------------------------------------------------------------------------------------------

SPEED_M_S = 2.5
"""More than this the flight never reaches, by half a metre per second."""
QUAD = Expected(text="", judged_s=18.0, frame="quad-x", rotors=CORNERS, speed_m_s=SPEED_M_S)
PX4_QUAD = replace(QUAD, frame="")


@dataclass(frozen=True)
class Case:
    """A log with one oddity."""

    write: Callable[[Path], None]
    suffix: str
    expected: Expected

    @property
    def name(self) -> str:
        """As the function that writes it."""
        return self.write.__name__


def quad_case(write: Callable[[Path], None], suffix: str, source: str, text: str, **more) -> Case:
    """A case of ``QUAD``, or of ``PX4_QUAD`` for a ``.ulg``."""
    base = PX4_QUAD if suffix == ".ulg" else QUAD
    return Case(write, suffix, replace(base, source=source, text=text, **more))


NEVER = Expected(text="").never
CASES = (
    quad_case(
        lane_switch,
        ".BIN",
        "ArduPilot/ardupilot#30395",
        "position and velocity of the estimator in use (XKF4.PI), before and after",
    ),
    quad_case(
        replayed_cores,
        ".BIN",
        "ArduPilot/ardupilot#28586",
        "estimator 0; cores from 100 on are not what flew",
    ),
    quad_case(
        esc_numbers_from_nine,
        ".BIN",
        "ArduPilot/ardupilot#27064",
        "motors 1 to 4 are outputs and ESCs 9 to 12",
        rotors=(9, 10, 11, 12),
    ),
    quad_case(
        esc_numbers_from_one,
        ".BIN",
        "ArduPilot/ardupilot#17538",
        "motors are outputs 9 to 12, their ESCs 1 to 4",
        rotors=(),
    ),
    quad_case(
        motors_from_17,
        ".BIN",
        "ArduPilot/ardupilot#16301",
        "outputs from RCO2 and RCO3, or a line that says that outputs above 16 are not read",
        rotors=(17, 18, 19, 20),
        refused="RCO2|RCO3|above 16|17",
    ),
    quad_case(
        corrupt_stamp,
        ".BIN",
        "Georacer/ardupilog#71",
        "one flight of 28 s; six messages are left out",
    ),
    quad_case(
        imu_frozen,
        ".BIN",
        "ArduPilot/ardupilot#1706",
        "IMU 1 is used; nothing is said against the accelerometer in use",
        never=(*NEVER, "disagrees with velocity"),
    ),
    quad_case(
        range_unplugged,
        ".BIN",
        "ArduPilot/ardupilot#8605",
        "the range does not move with the vehicle: a fault; judged as free air",
        says="stays at 0.21 m",
    ),
    quad_case(
        range_says_no_data,
        ".BIN",
        "ArduPilot/ardupilot#31155",
        "no reading is good: no height, judged as free air",
        never=(*NEVER, r"yes +height over ground"),
    ),
    quad_case(
        parameter_in_flight,
        ".BIN",
        "srikanthgoli1/rrc_fault_tolerant_control simulation-set-1",
        "the vehicle as its parameters were in flight, a quad-x; motor 1 is switched off from 26 s on",
        names=(*DRAG, "fan_imbalance"),
        says=r"motor 1 \(front right, output 1\) is switched off from",
    ),
    quad_case(
        no_battery_monitor,
        ".BIN",
        "erlerobot/logs pxf/copter/25-9-2014",
        "no battery voltage in the log",
        never=(*NEVER, r"yes +battery sag"),
    ),
    quad_case(
        unused_outputs_hold_anything,
        ".BIN",
        "erlerobot/logs pxf/copter/25-9-2014",
        "only outputs 1 to 4 count",
    ),
    quad_case(
        simulator_hovers_still,
        ".BIN",
        "srikanthgoli1/rrc_fault_tolerant_control temp/log_18",
        "it flew: 10 m up by estimator and barometer",
        speed_m_s=4.0,
    ),
    quad_case(
        estimator_falls_on_the_bench,
        ".BIN",
        "erlerobot/logs pxf/copter/6-3-2014",
        "it did not fly: nothing moves but the estimator's velocity",
        judged_s=0.0,
        judged_most_s=0.0,
        never=("tandem coaxial",),
        refused="did not fly",
    ),
    quad_case(
        can_is_first,
        ".ulg",
        "PX4/PX4-Autopilot#20747",
        "the fourth instance: PWM_AUX_FUNCn names the motors",
    ),
    quad_case(
        can_drives_motors,
        ".ulg",
        "PX4/PX4-Autopilot#16414",
        "the third instance: UAVCAN_EC_FUNCn names the motors, 8191 is full",
    ),
    quad_case(
        only_actuator_motors,
        ".ulg",
        "PX4/PX4-Autopilot#20747",
        "thrust from actuator_motors",
    ),
    quad_case(
        indoors,
        ".ulg",
        "PX4/PX4-Autopilot#11031",
        "no position, no velocity over ground; forces are judged, wind and drag are not",
        names=(),
        never=(*NEVER, r"yes +wind and drag"),
    ),
    quad_case(
        esc_one_stuck,
        ".ulg",
        "PX4/PX4-Autopilot#17569",
        "a fault of ESC 1",
        says="stays at 1000 rpm",
    ),
    quad_case(
        gimbal_and_adsb,
        ".tlog",
        "ArduPilot/MAVProxy#598, ArduPilot/MissionPlanner#947",
        "one quadcopter; attitude and IMU of component 1",
    ),
    quad_case(
        second_battery_without_cells,
        ".tlog",
        "ArduPilot/MissionPlanner#2054",
        "battery 0: 15.5 to 16.5 V",
        volts=VOLTS,
    ),
    quad_case(
        esc_batches,
        ".tlog",
        "PX4/PX4-Autopilot#23596",
        "a hexa-x; ESCs 5 and 6 are copies of 1 and 2, and not believed",
        frame="hexa-x",
        rotors=(1, 2, 3, 4, 5, 6),
        judged_s=15.0,
    ),
    quad_case(
        watchdog_reset,
        ".tlog",
        "ArduPilot/ardupilot#14582",
        "two boots; the first is judged until it ends in the air, the fall is no flight",
        judged_s=12.0,
        judged_most_s=20.0,
    ),
    quad_case(
        speed_spikes,
        ".tlog",
        "am32-firmware/AM32#242",
        "single readings of 38 000 rpm are left out",
        judged_s=15.0,
    ),
    quad_case(
        parameters_cut_short,
        ".tlog",
        "ziti-hex/slung-load-estimator data/Messdaten",
        "a quad-x on outputs 1 to 4: the other functions did not arrive",
    ),
    quad_case(
        system_zero,
        ".tlog",
        "akj127/drone_rover worlds",
        "system 0 is a vehicle like others",
    ),
)
