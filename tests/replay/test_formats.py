"""The registry, and .BIN and .ulg with known content."""

import math
import tracemalloc

import numpy as np
import pytest
from log_writers import BinWriter, UlgWriter, bin_flight, ulg_flight

from companion.mavlink.dialect import mavlink
from companion.mavlink.samples import RangeVerdict
from models.common.errors import LogError
from models.common.frames import quaternion_from_euler
from models.vehicle.estimate import pwm_range
from replay.logs.formats import READERS, load, suffix_of


def test_suffixes_in_any_case(tmp_path):
    assert suffix_of(tmp_path / "A.BIN") == ".bin"
    assert suffix_of(tmp_path / "b.TLog") == ".tlog"
    assert set(READERS) == {".tlog", ".bin", ".ulg"}


@pytest.mark.parametrize("name", ["flight.csv", "flight", "flight.tlog.gz"])
def test_an_unknown_suffix_names_the_known_ones(tmp_path, name):
    (tmp_path / name).write_bytes(b"x")
    with pytest.raises(LogError, match=r"known: \.tlog, \.bin, \.ulg"):
        load(tmp_path / name)


@pytest.mark.parametrize("name", ["flight.log", "flight", "2024-01-01.raw"])
def test_a_log_under_another_name_is_known_by_its_content(tmp_path, name):
    path, mav = tmp_path / name, mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    path.write_bytes(bin_flight())
    assert suffix_of(path) == ".bin"
    (log,) = load(path)
    assert len(log.attitude) > 150
    path.write_bytes(ulg_flight())
    assert suffix_of(path) == ".ulg"
    frames = [
        mav.attitude_quaternion_encode(20 * k, 1, 0, 0, 0, 0, 0, 0).pack(mav) for k in range(5)
    ]
    path.write_bytes(
        b"".join((10**15 + 20_000 * k).to_bytes(8, "big") + raw for k, raw in enumerate(frames))
    )
    assert suffix_of(path) == ".tlog"
    path.write_bytes(b"".join(frames))
    with pytest.raises(LogError, match="no known log format"):
        suffix_of(path)


@pytest.mark.parametrize("suffix", [".bin", ".ulg", ".tlog"])
@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda p: None, "cannot be read"),
        (lambda p: p.mkdir(), "is a directory"),
        (lambda p: p.write_bytes(b""), "is empty"),
        (lambda p: p.write_bytes(bytes(range(256)) * 40), None),
    ],
)
def test_bad_files_are_one_line(tmp_path, suffix, make, words):
    path = tmp_path / f"flight{suffix}"
    make(path)
    with pytest.raises(LogError, match=words) as caught:
        load(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(("suffix", "content"), [(".bin", bin_flight), (".ulg", ulg_flight)])
@pytest.mark.parametrize("share", [0.001, 0.02, 0.1, 0.37, 0.9])
def test_a_cut_file_gives_what_it_holds_or_one_line(tmp_path, suffix, content, share):
    path = tmp_path / f"cut{suffix}"
    data = content()
    path.write_bytes(data[: int(len(data) * share)])
    try:
        logs = load(path)
    except LogError as error:
        assert "\n" not in str(error)  # noqa: PT017 - a cut file may also be readable
    else:
        assert logs[0].duration_s >= 0.0


def test_bin(tmp_path):
    path = tmp_path / "flight.BIN"
    path.write_bytes(bin_flight())
    (log,) = load(path)
    assert (log.start_s, round(log.duration_s, 2), log.autopilot) == (10.0, 3.98, 3)
    expected = quaternion_from_euler(*np.radians((2.0, -1.0, 90.0)))
    assert log.attitude.values[0] == pytest.approx(expected)
    assert np.allclose(log.position.values, (1.0, 2.0, -0.5)), "the first EKF core only"
    assert np.allclose(log.velocity.values, (0.1, 0.2, 0.3))
    assert np.allclose(log.imus[0].specific_force.values, (0.1, 0.2, -9.8))
    assert np.allclose(log.rates.values, (0.01, 0.02, 0.03))
    assert log.servo.values[0, :5].tolist() == [1500, 1510, 1520, 1530, 0]
    assert sorted(log.escs) == [1, 2, 3, 4]
    assert np.all(log.escs[4].rpm.values == 4030.0)
    down = log.beam("down")
    assert down.verdicts.count(RangeVerdict.OK) == 199
    assert down.verdicts[7] is RangeVerdict.ABOVE_MAX
    assert np.allclose(log.battery.values, (16.0, 20.0))
    (armed,) = log.armed
    assert (armed.start_s, armed.end_s) == (11.0, 13.0)
    assert log.parameters == {"GUID_OPTIONS": 8.0}


def test_a_bin_that_begins_after_arming_was_armed_from_its_start(tmp_path):
    """LOG_DISARMED 0: the log begins when the vehicle is armed, and the message of arming may come before its first."""
    path = tmp_path / "flight.BIN"
    path.write_bytes(bin_flight(arming=False))
    (log,) = load(path)
    (armed,) = log.armed
    assert (armed.start_s, armed.end_s) == (10.0, 13.0)


def test_ulg(tmp_path):
    pytest.importorskip("pyulog")
    path = tmp_path / "flight.ulg"
    path.write_bytes(ulg_flight())
    (log,) = load(path)
    assert (log.system, log.autopilot, log.vehicle_type) == (3, 12, 2)
    assert log.start_s == 20.0
    assert np.allclose(log.attitude.values, (1, 0, 0, 0))
    assert np.allclose(log.rates.values, (0.1, 0.2, 0.3))
    assert np.isnan(log.velocity.values[5]).tolist() == [True, True, False]
    forward = log.beam("forward")
    assert forward.distance.values[0, 0] == 1.5
    assert forward.sigma_m == pytest.approx(0.02)
    assert forward.verdicts[9] is RangeVerdict.LOW_QUALITY
    assert forward.verdicts.count(RangeVerdict.OK) == 199
    assert math.isnan(log.battery.values[0, 1])
    assert log.servo.values[0].tolist() == list(range(1000, 1016))
    assert [i.value for i in log.modes] == [6 << 16]
    assert log.armed[0].start_s == pytest.approx(20.22)
    assert log.parameters == {"MPC_THR_HOVER": 0.5}


def test_recorded_bin_and_ulg(shared_data):
    (old,) = load(shared_data / "open" / "bin_dronekit_la_log171.bin")
    assert [len(i.specific_force) for i in old.imus] == [11916] * 3
    assert 14.0 < np.nanmin(old.battery.values[:, 0]) < np.nanmax(old.battery.values[:, 0]) < 17.0
    assert old.armed
    (sitl,) = load(shared_data / "open" / "ulg_pyulog_sample_px4_events_SITL.ulg")
    assert max(float(e.rpm.values.max()) for e in sitl.escs.values()) == pytest.approx(3324, abs=1)
    assert not sitl.beams  # its bits say that no sensor measures dist_bottom


def test_a_damaged_bin_is_read_around_the_damage_without_a_word(tmp_path, capfd):
    data = bytearray(bin_flight())
    for k in range(5000, len(data), 4000):
        data[k : k + 5] = b"\xff\x00\xa3\x95\xff"
    (tmp_path / "hurt.bin").write_bytes(data)
    (log,) = load(tmp_path / "hurt.bin")
    assert len(log.attitude) > 150
    assert capfd.readouterr() == ("", "")


def test_mode_changes_and_events_far_apart_are_all_kept(tmp_path):
    w = BinWriter()
    w.kind("ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    w.kind("MODE", "QBB", "TimeUS,Mode,ModeNum")
    w.kind("EV", "QB", "TimeUS,Id")
    for k in range(3500):
        us = 10_000_000 + 20_000 * k
        if k % 500 == 0:
            w.row("MODE", us, k // 500, k // 500)
            w.row("EV", us, 28 if k % 1000 else 18)
        w.row("ATT", us, 0.0, 2.0, 0.0, -1.0, 90.0, 90.0)
    path = tmp_path / "modes.bin"
    path.write_bytes(w.bytes())
    (log,) = load(path)
    assert [i.value for i in log.modes] == [0, 1, 2, 3, 4, 5, 6]
    assert [i.value for i in log.landed] == [1, 2, 1, 2, 1, 2, 1]
    assert [round(i.start_s) for i in log.modes] == [10, 20, 30, 40, 50, 60, 70]


@pytest.mark.slow
def test_a_dataflash_log_is_kept_as_numbers_not_as_objects(tmp_path):
    """Peak of what the reader allocates, over the size of the file: rows of Python objects would be above twenty."""
    path = tmp_path / "long.bin"
    path.write_bytes(bin_flight(200.0))
    tracemalloc.start()
    load(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 12.0 * path.stat().st_size


def test_an_old_bin_without_a_message_of_arming_was_armed_while_it_had_throttle(tmp_path):
    w = BinWriter()
    w.kind("ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    w.kind("CTUN", "Qf", "TimeUS,ThO")
    w.kind("MODE", "Bh", "Mode,ThrCrs")
    w.kind("EV", "B", "Id")
    for k in range(200):
        us = 10_000_000 + 20_000 * k
        w.row("ATT", us, 0.0, 2.0, 0.0, -1.0, 90.0, 90.0)
        w.row("CTUN", us, 0.4 if 50 <= k < 150 else 0.0)
        if k == 20:
            w.row("MODE", 5, 400)
            w.row("EV", 15)
    path = tmp_path / "old.bin"
    path.write_bytes(w.bytes())
    log = load(path)[0]
    assert [(i.start_s, i.end_s) for i in log.armed] == [pytest.approx((11.0, 12.98))]
    assert [(i.start_s, i.value) for i in log.modes] == [(pytest.approx(10.4), 5)]


def px4(path, outputs, parameters, functions=()):
    """A short flight with these instances of outputs, and ESCs with these actuator functions."""
    w = UlgWriter()
    w.topic("vehicle_attitude", ("float[4]", "q"))
    for i in range(len(outputs)):
        w.topic(f"actuator_outputs:{i}", ("float[16]", "output"))
    escs = [(kind, f"esc[{i}].{n}") for i in range(len(functions)) for kind, n in _ESC_FIELDS]
    w.topic("esc_status", *escs)
    for name, value in parameters.items():
        w.parameter(name, value)
    w.subscribe()
    for k in range(100):
        w.row("vehicle_attitude", 20_000_000 + 20_000 * k, 1.0, 0.0, 0.0, 0.0)
        for i, sent in enumerate(outputs):
            values = [(1.0 - 0.1 * (k % 2)) * value for value in sent]
            w.row(
                f"actuator_outputs:{i}",
                20_000_000 + 20_000 * k,
                *values,
                *[0.0] * (16 - len(values)),
            )
        w.row(
            "esc_status",
            20_000_000 + 20_000 * k,
            *(v for i, f in enumerate(functions) for v in (1000.0 * (i + 1), f)),
        )
    path.write_bytes(w.bytes())
    return load(path)[0]


_ESC_FIELDS = (("float", "esc_rpm"), ("uint8_t", "actuator_function"))


@pytest.mark.parametrize(
    ("outputs", "parameters", "full"),
    [
        ([[1999.0, 999.5]], {"PWM_MAIN_TIM0": -4}, (0.0, 1999.0)),
        ([[1999.0, 1500.0]], {"PWM_MAIN_TIM2": -4, "PWM_MAIN_FUNC1": 101}, (0.0, 1999.0)),
        ([[0.0, 0.0], [8191.0, 4095.5]], {"UAVCAN_ENABLE": 3}, (0.0, 8191.0)),
        ([[0.0, 0.0], [8191.0, 4095.5]], {"UAVCAN_EC_FUNC1": 101}, (0.0, 8191.0)),
        ([[1200.0, 1800.0]], {}, (1000.0, 2000.0)),
        ([[1200.0, 1800.0]], {"PWM_AUX_FUNC1": 101, "PWM_AUX_MIN1": 1100, "PWM_AUX_MAX1": 1900}, (1100.0, 1900.0)),
    ],
)  # fmt: skip
def test_outputs_of_px4_are_as_sent_and_have_the_range_of_their_driver(
    tmp_path, outputs, parameters, full
):
    log = px4(tmp_path / "outputs.ulg", outputs, parameters)
    assert log.servo.values[0, :2] == pytest.approx(outputs[-1])
    assert pwm_range(log.parameters, 1, log.motor_outputs.group)[:2] == full


def test_an_esc_of_px4_is_the_motor_that_its_function_names(tmp_path):
    log = px4(tmp_path / "escs.ulg", [[1500.0]], {}, functions=(102, 104, 101, 103))
    assert {esc: e.rpm.values[0, 0] for esc, e in log.escs.items()} == {
        1: 3000.0,
        2: 1000.0,
        3: 4000.0,
        4: 2000.0,
    }
