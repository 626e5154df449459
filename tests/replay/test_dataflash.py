"""Dataflash logs of every age: old names and clocks, declarations that change or are missing, logs as text."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from log_writers import BinWriter, TextWriter, bin_flight

from models.common.errors import LogError
from models.common.frames import quaternion_from_euler
from replay.flightlog import FlightLog
from replay.logs.formats import load

START_US = 10_000_000


def read(path: Path, data: bytes, name: str = "flight.BIN") -> FlightLog:
    """The only boot of a log."""
    (path / name).write_bytes(data)
    (log,) = load(path / name)
    return log


# --- old names and clocks ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("message", "prefix", "count"),
    [
        ("RCOU", "C", 14),
        ("RCOU", "Ch", 8),
        ("RCOU", "Chan", 8),
        ("MOT", "Mot", 4),
        ("MOT", "Mot", 8),
    ],
)
def test_outputs_of_every_version(message, prefix, count, tmp_path):
    """Chan1 to ArduCopter 3.2, Ch1 and C1 since; MOT, without a stamp, to 3.0."""
    w = BinWriter()
    stamped = message == "RCOU"
    names = [f"{prefix}{i}" for i in range(1, count + 1)]
    w.kind("ATT", "IccccCC", "TimeMS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    w.kind(message, "I" * stamped + "h" * count, ",".join(["TimeMS"] * stamped + names))
    for k in range(100):
        w.row("ATT", 10_000 + 20 * k, 0, 200, 0, -100, 0, 9000)
        w.row(message, *[10_000 + 20 * k] * stamped, *range(1100, 1100 + count))
    log = read(tmp_path, w.bytes())
    assert log.servo is not None
    assert len(log.servo) == 100
    assert log.servo.values[0].tolist() == [*range(1100, 1100 + count), *[0] * (16 - count)]
    assert log.servo.t_s[[0, -1]] == pytest.approx([10.0, 11.98])


def copter_3_0(gps_time: str) -> BinWriter:
    """Only GPS has a time, that of the week. Angles are hundredths of degrees, CURR hundredths of volts and amperes."""
    w = BinWriter()
    w.kind("GPS", "BIBciieeEe", f"Status,{gps_time},NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs")
    w.kind("ATT", "cccccCC", "RollIn,Roll,PitchIn,Pitch,YawIn,Yaw,NavYaw")
    w.kind("IMU", "ffffff", "GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    w.kind("CURR", "hIhhhf", "Thr,ThrInt,Volt,Curr,Vcc,CurrTot")
    w.kind("CTUN", "hcefhhhhh", "ThrIn,SonAlt,BarAlt,WPAlt,NavThr,AngBst,CRate,ThrOut,DCRate")
    w.kind("MODE", "Mh", "Mode,ThrCrs")
    w.kind("MOT", "hhhh", "Mot1,Mot2,Mot3,Mot4")
    w.row("MODE", 5, 400)
    for k in range(500):
        if k % 10 == 0:
            w.row("GPS", 3, 345_600_000 + 20 * k, 9, 150, 0, 0, 0, 0, 0, 0)
            w.row("CURR", 500, 0, 1620, 1200, 5000, 1.0)
        w.row("ATT", 0, 200, 0, -100, 0, 9000, 9000)
        w.row("IMU", 0.01, 0.02, 0.03, 0.1, 0.2, -9.8)
        w.row("CTUN", 500, 0, 0, 0.0, 0, 0, 0, 480, 0)
        w.row("MOT", 1500, 1510, 1520, 1530)
    return w


@pytest.mark.parametrize("gps_time", ["Time", "TimeMS"])
def test_a_log_whose_only_clock_is_that_of_gps(gps_time, tmp_path):
    log = read(tmp_path, copter_3_0(gps_time).bytes())
    assert log.duration_s == pytest.approx(9.8, abs=0.05)
    assert log.attitude is not None
    assert log.attitude.rate_hz == pytest.approx(50.0, rel=0.1)
    assert log.attitude.values[0] == pytest.approx(
        quaternion_from_euler(*np.radians((2.0, -1.0, 90.0)))
    )
    assert log.battery is not None
    assert log.battery.values[0] == pytest.approx([16.2, 12.0])
    assert log.thrust_command is not None
    assert log.thrust_command.values[0, 0] == pytest.approx(0.48)
    assert log.servo is not None
    assert log.servo.values[0, :4].tolist() == [1500, 1510, 1520, 1530]
    assert log.gps_fix is not None
    assert set(log.gps_fix.values[:, 0].tolist()) == {3.0}
    (clock,) = [source for source in log.sources if source.quantity == "clock"]
    assert "GPS" in clock.chosen


def test_a_log_without_any_clock_is_one_line(tmp_path):
    w = BinWriter()
    w.kind("ATT", "cccccCC", "RollIn,Roll,PitchIn,Pitch,YawIn,Yaw,NavYaw")
    for _ in range(100):
        w.row("ATT", 0, 200, 0, -100, 0, 9000, 9000)
    with pytest.raises(LogError, match="believable time"):
        read(tmp_path, w.bytes())


# --- declarations -----------------------------------------------------------------------------------------------------


IMU = ("QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
NUMBERS = (0, 0.01, 0.02, 0.03, 0.1, 0.2, -9.8)


def with_imu_anew(change: Callable[[BinWriter], None], after: tuple[float, ...] = NUMBERS) -> bytes:
    """A hundred messages, another declaration, a hundred more."""
    w = BinWriter()
    w.kind("ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    w.kind("IMU", *IMU)
    for k in range(200):
        if k == 100:
            change(w)
        w.row("IMU", START_US + 20_000 * k, *(NUMBERS if k < 100 else after))
        w.row("ATT", START_US + 20_000 * k, 0.0, 2.0, 0.0, -1.0, 90.0, 90.0)
    return w.bytes()


def force(log: FlightLog) -> np.ndarray:
    """Specific force (n, 3) of the first IMU."""
    return log.imus[0].specific_force.values


@pytest.mark.parametrize(
    ("formats", "columns", "after"),
    [
        ("QBfffffff", f"{IMU[1]},T", (*NUMBERS, 40.0)),
        (
            "QfffffffB",
            "TimeUS,AccX,AccY,AccZ,GyrX,GyrY,GyrZ,T,I",
            (0.1, 0.2, -9.8, 0.01, 0.02, 0.03, 40.0, 0),
        ),
        ("Qhhhccc", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ", (0, 0, 0, 10, 20, -980)),
    ],
    ids=["a field more", "another order", "hundredths"],
)
def test_a_message_that_is_declared_anew_follows_the_new_declaration(
    formats, columns, after, tmp_path
):
    log = read(tmp_path, with_imu_anew(lambda w: w.kind("IMU", formats, columns), after))
    assert len(force(log)) == 200
    assert np.allclose(force(log), (0.1, 0.2, -9.8))
    assert len(log.attitude) == 200
    assert any("IMU is declared anew" in note for note in log.summary.notes)


def test_a_field_that_the_new_declaration_leaves_out_is_said(tmp_path):
    change = ("QBfffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY")
    log = read(tmp_path, with_imu_anew(lambda w: w.kind("IMU", *change), NUMBERS[:-1]))
    assert np.isnan(force(log)[100:, 2]).all()
    assert np.isfinite(force(log)[:100]).all()
    assert "IMU is declared anew in the midst of the log, without AccZ" in log.summary.notes


@pytest.mark.parametrize("length", [0, 2, 36, 60, 255])
def test_a_declaration_that_the_messages_contradict_is_not_believed(length, tmp_path):
    """The messages go on as before."""
    log = read(tmp_path, with_imu_anew(lambda w: w.kind("IMU", *IMU, length=length)))
    assert len(force(log)) == 200
    assert np.allclose(force(log), (0.1, 0.2, -9.8))
    assert len(log.attitude) == 200


def test_a_declaration_of_another_length_and_other_fields_that_no_message_follows(tmp_path):
    def change(w: BinWriter) -> None:
        w.kind("IMU", "QBfffffff", f"{IMU[1]},T")
        w.undeclared("IMU", 131, IMU[0])

    log = read(tmp_path, with_imu_anew(change))
    assert len(force(log)) == 200
    assert np.allclose(force(log), (0.1, 0.2, -9.8))


def test_messages_whose_declaration_does_not_add_up_are_said(tmp_path):
    """Four bytes that no field declares follow every message."""

    def change(w: BinWriter) -> None:
        w.kind("IMU", *IMU, length=40)
        w.undeclared("IMU", 131, "QBfffffff")

    log = read(tmp_path, with_imu_anew(change, (*NUMBERS, 0.0)))
    assert len(log.attitude) == 200
    assert len(force(log)) == 100
    assert any(note.startswith("100 messages IMU not read") for note in log.summary.notes)


def test_messages_without_a_declaration_are_skipped_and_said(tmp_path):
    w = BinWriter()
    w.kind("ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    w.undeclared("IMU", 77, IMU[0])
    for k in range(100):
        w.row("ATT", START_US + 20_000 * k, 0.0, 2.0, 0.0, -1.0, 90.0, 90.0)
        w.row("IMU", START_US + 20_000 * k, *NUMBERS)
    log = read(tmp_path, w.bytes())
    assert len(log.attitude) == 100
    assert "100 messages not read: no FMT declares their type (77)" in log.summary.notes


def test_first_bytes_of_a_message_inside_one_without_a_declaration_are_no_message(tmp_path):
    """The payload looks like an ATT message; nothing follows where that would end."""
    w = BinWriter()
    w.kind("ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    w.undeclared("ODD", 77, "N")
    for k in range(100):
        w.row("ATT", START_US + 20_000 * k, 0.0, 2.0, 0.0, -1.0, 90.0, 90.0)
        w.row("ODD", b"1234\xa3\x95\x82 and so on")
    log = read(tmp_path, w.bytes())
    assert len(log.attitude) == 100
    assert np.ptp(log.attitude.values, axis=0).max() == 0.0


def test_outputs_that_are_named_anew_do_not_stop(tmp_path):
    w = BinWriter()
    w.kind("ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    w.kind("RCOU", "QHHHH", "TimeUS,Chan1,Chan2,Chan3,Chan4")
    for k in range(300):
        if k == 100:
            w.kind("RCOU", "QHHHHH", "TimeUS,C1,C2,C3,C4,C5")
        if k == 200:
            w.kind("RCOU", "QHH", "TimeUS,C1,C2")
        count = (4, 5, 2)[k // 100]
        w.row("ATT", START_US + 20_000 * k, 0.0, 2.0, 0.0, -1.0, 90.0, 90.0)
        w.row("RCOU", START_US + 20_000 * k, *range(1500, 1500 + count))
    log = read(tmp_path, w.bytes())
    assert log.servo is not None
    assert np.all(log.servo.values[:200, :4] == [1500, 1501, 1502, 1503])
    assert np.all(log.servo.values[200:, :2] == [1500, 1501])
    assert np.isnan(log.servo.values[200:, 2:4]).all(), "unknown, not stopped"
    assert any("without C3, C4, C5" in note for note in log.summary.notes)


# --- declared units ---------------------------------------------------------------------------------------------------


def with_units(w: BinWriter, units: dict[int, tuple[str, str]]) -> None:
    """UNIT, MULT and FMTU as ArduPilot writes them since 3.6."""
    w.kind("UNIT", "QbZ", "TimeUS,Id,Label")
    w.kind("MULT", "Qbd", "TimeUS,Id,Mult")
    w.kind("FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
    labels = {
        "s": "s",
        "v": "V",
        "A": "A",
        "E": "rad/s",
        "k": "deg/s",
        "o": "m/s/s",
        "#": "instance",
        "d": "deg",
    }
    for sign, label in labels.items():
        w.row("UNIT", 0, ord(sign), label)
    for sign, number in {"-": 0.0, "?": 1.0, "0": 1.0, "B": 1e-2, "C": 1e-3, "F": 1e-6}.items():
        w.row("MULT", 0, ord(sign), number)
    for number, (ids, multipliers) in units.items():
        w.row("FMTU", 0, number, ids, multipliers)


def test_declared_units_and_multipliers_are_used(tmp_path):
    """Millivolts as whole numbers, gyros in deg/s; angles in hundredths by their format say so again."""
    w = BinWriter()
    w.kind("ATT", "QccccCC", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    w.kind("IMU", *IMU)
    w.kind("BAT", "QBHf", "TimeUS,Inst,Volt,Curr")
    with_units(
        w, {130: ("sdddddd", "FBBBBBB"), 131: ("s#kkkooo", "F-000000"), 132: ("s#vA", "F-C0")}
    )
    for k in range(100):
        us = START_US + 20_000 * k
        w.row("ATT", us, 0, 200, 0, -100, 0, 9000)
        w.row("IMU", us, 0, 10.0, 20.0, 30.0, 0.1, 0.2, -9.8)
        w.row("BAT", us, 0, 16_200, 12.0)
    log = read(tmp_path, w.bytes())
    assert log.attitude.values[0] == pytest.approx(
        quaternion_from_euler(*np.radians((2.0, -1.0, 90.0)))
    )
    assert np.degrees(log.imus[0].gyro.values[0]) == pytest.approx([10.0, 20.0, 30.0])
    assert force(log)[0] == pytest.approx([0.1, 0.2, -9.8])
    assert log.battery.values[0] == pytest.approx([16.2, 12.0])
    assert log.start_s == pytest.approx(10.0)


@pytest.mark.parametrize("ids", ["", "s", "s#kkkooooooo", "\xff" * 8])
def test_units_that_do_not_fit_the_message_are_not_used(ids, tmp_path):
    w = BinWriter()
    w.kind("IMU", *IMU)
    with_units(w, {130: (ids, "F-000000")})
    for k in range(100):
        w.row("IMU", START_US + 20_000 * k, *NUMBERS)
    assert np.allclose(read(tmp_path, w.bytes()).imus[0].gyro.values, (0.01, 0.02, 0.03))


# --- reboots and gaps -------------------------------------------------------------------------------------------------


def hover(w: BinWriter, start_us: int, count: int) -> None:
    """Attitudes at 50 Hz."""
    for k in range(count):
        w.row("ATT", start_us + 20_000 * k, 0.0, 2.0, 0.0, -1.0, 90.0, 90.0)


def attitudes() -> BinWriter:
    w = BinWriter()
    w.kind("PARM", "QNf", "TimeUS,Name,Value")
    w.kind("ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    w.row("PARM", START_US, "GUID_OPTIONS", 8.0)
    return w


@pytest.mark.filterwarnings("error")
def test_a_parameter_that_is_no_number_is_left_out_in_silence(tmp_path):
    w = attitudes()
    w.row("PARM", START_US, "ATC_RAT_RLL_P", 1234.5)
    hover(w, 100_000_000, 200)
    signalling = b"\x01\x00\x80\x7f"
    (tmp_path / "flight.BIN").write_bytes(w.bytes().replace(struct.pack("<f", 1234.5), signalling))
    (flight,) = load(tmp_path / "flight.BIN")
    assert flight.parameters == {"GUID_OPTIONS": 8.0}


def test_a_reboot_in_the_midst_of_a_log_starts_a_flight_of_its_own(tmp_path):
    w = attitudes()
    hover(w, 100_000_000, 200)
    hover(w, 3_000_000, 300)
    (tmp_path / "flight.BIN").write_bytes(w.bytes())
    first, second = load(tmp_path / "flight.BIN")
    assert (first.boot, second.boot) == (0, 1)
    assert (first.start_s, len(first.attitude)) == (pytest.approx(100.0), 200)
    assert (second.start_s, len(second.attitude)) == (pytest.approx(3.0), 300)
    assert first.parameters == second.parameters == {"GUID_OPTIONS": 8.0}


def test_a_gap_of_a_minute_is_a_gap(tmp_path):
    w = attitudes()
    hover(w, 100_000_000, 200)
    hover(w, 164_000_000, 200)
    log = read(tmp_path, w.bytes())
    assert len(log.attitude) == 400
    assert np.diff(log.attitude.t_s).max() == pytest.approx(60.02)


# --- as text ----------------------------------------------------------------------------------------------------------


WRITERS = {
    "windows": TextWriter,
    "unix": lambda: TextWriter(end="\n"),
    "no spaces": lambda: TextWriter(separator=","),
    "decimal commas": lambda: TextWriter(decimal=","),
    "semicolons and decimal commas": lambda: TextWriter(separator=";", decimal=","),
}


@pytest.mark.parametrize("name", ["flight.log", "flight.txt", "flight.BIN", "flight"])
@pytest.mark.parametrize("writer", WRITERS.values(), ids=WRITERS)
def test_a_log_as_text_is_the_log(writer, name, tmp_path):
    log = read(tmp_path, bin_flight(writer=writer()), name)
    same = read(tmp_path, bin_flight(), "same.BIN")
    for column in ("attitude", "rates", "position", "velocity", "servo", "battery"):
        ours, theirs = getattr(log, column), getattr(same, column)
        assert ours.t_s == pytest.approx(theirs.t_s), column
        assert ours.values == pytest.approx(theirs.values), column
    assert force(log) == pytest.approx(force(same))
    assert log.armed == same.armed
    assert log.modes == same.modes
    assert log.parameters == same.parameters
    assert log.beam("down").verdicts == same.beam("down").verdicts
    assert log.summary.bytes == (tmp_path / name).stat().st_size
    assert log.summary.notes == ()


def test_hundredths_mode_names_and_texts_with_commas(tmp_path):
    w = TextWriter()
    w.kind("ATT", "IccccCC", "TimeMS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    w.kind("MODE", "QMh", "TimeUS,Mode,ThrCrs")
    w.kind("MSG", "QZ", "TimeUS,Message")
    w.row("MSG", START_US, "ArduCopter V3.2, frame: QUAD, ready")
    w.lines.append(f"MODE, {START_US}, AltHold, 400")
    for k in range(100):
        w.row("ATT", 10_000 + 20 * k, 0, 200, 0, -100, 0, 9000)
    log = read(tmp_path, w.bytes(), "flight.log")
    assert log.attitude.values[0] == pytest.approx(
        quaternion_from_euler(*np.radians((2.0, -1.0, 90.0)))
    )
    assert [text for *_, text in log.texts] == ["ArduCopter V3.2, frame: QUAD, ready"]
    assert [interval.value for interval in log.modes] == [2]


def test_a_cut_last_line_and_lines_that_fit_nothing_are_said(tmp_path):
    data = b"ArduCopter V3.1.3\r\nFree RAM: 1331\r\n" + bin_flight(writer=TextWriter())[:-9]
    log = read(tmp_path, data + b"\r\nXYZ, 1, 2\r\nIMU, what, is, this\r\n", "flight.log")
    assert len(log.attitude) == 200
    assert any(
        note.startswith("2 lines not read: they do not fit their FMT line")
        for note in log.summary.notes
    )
    assert any(
        note.startswith("1 lines not read: they have no FMT line (XYZ)")
        for note in log.summary.notes
    )


def test_two_logs_as_text_in_one_file_are_two_flights(tmp_path):
    data = bin_flight(writer=TextWriter()) + b"\r\n" + bin_flight(8.0, writer=TextWriter())
    (tmp_path / "two.log").write_bytes(data)
    assert [round(log.duration_s) for log in load(tmp_path / "two.log")] == [4, 8]


@pytest.mark.parametrize(
    "text",
    [
        "07946, 00.00, +00.00\r\n" * 50,
        "2019-01-01 12:00:00.00: ATT {TimeUS : 123, DesRoll : 0.0}\n" * 50,
        "timestamp,roll,pitch\n1,2,3\n",
    ],
)
def test_text_that_is_no_dataflash_log_is_one_line(text, tmp_path):
    (tmp_path / "flight.log").write_text(text)
    with pytest.raises(
        LogError, match=r"it is text, but no dataflash log .* give the \.BIN"
    ) as caught:
        load(tmp_path / "flight.log")
    assert "\n" not in str(caught.value)


def test_text_of_which_no_line_can_be_read_is_one_line(tmp_path):
    """Decimal commas between commas: nobody can tell them apart."""
    w = TextWriter(separator=",", decimal=",")
    w.kind("IMU", "fff", "GyrX,GyrY,GyrZ")
    w.row("IMU", 0.1, 0.2, 0.3)
    (tmp_path / "flight.log").write_bytes(w.bytes())
    with pytest.raises(LogError, match=r"no line fits its FMT line: give the \.BIN"):
        load(tmp_path / "flight.log")


def test_binary_content_under_the_name_of_a_text_log(tmp_path):
    assert len(read(tmp_path, bin_flight(), "flight.log").attitude) == 200


def test_no_bytes_crash_the_reader_of_texts(tmp_path):
    rng = np.random.default_rng(3)
    data = bytearray(bin_flight(1.0, writer=TextWriter()))
    for place in rng.integers(100, len(data), 400):
        data[place] = int(rng.integers(1, 256))
    (tmp_path / "hurt.log").write_bytes(data)
    (log,) = load(tmp_path / "hurt.log")
    assert len(log.attitude) > 20
