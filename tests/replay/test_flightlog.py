"""FlightLog: known content in, the same out, on one axis."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from log_writers import EPOCH_US, flight, frame, heartbeat, write_tlog
from scipy.spatial.transform import Rotation

from companion.mavlink.dialect import mavlink
from companion.mavlink.samples import RangeVerdict
from companion.mavlink.wire_frames import cut
from models.common.errors import LogError
from replay.flightlog import Series, direction_name
from replay.logs.columns import smallest_step, tidy, unflipped
from replay.logs.formats import load
from replay.residual.log_state import under_open_sky


def logs_of(tmp_path, messages, **options):
    path = tmp_path / "flight.tlog"
    write_tlog(path, messages)
    return load(path, **options)


@pytest.fixture(scope="module")
def hover(tmp_path_factory):
    (log,) = logs_of(tmp_path_factory.mktemp("hover"), flight(10.0))
    return log


def test_span_and_identity(hover):
    assert (hover.system, hover.boot, hover.autopilot, hover.vehicle_type) == (1, 0, 3, 2)
    assert hover.start_s == pytest.approx(40.0)
    assert hover.duration_s == pytest.approx(9.98)
    assert hover.parameters == {"GUID_OPTIONS": 8.0}


def test_stamped_columns_are_exact(hover):
    assert len(hover.attitude) == 500
    assert hover.attitude.rate_hz == pytest.approx(50.0)
    yaw, pitch, roll = (
        Rotation.from_quat(hover.attitude.values, scalar_first=True).as_euler("ZYX").T
    )
    assert np.allclose(roll, 0.1 * np.sin(hover.attitude.t_s), atol=1e-6)
    assert np.allclose(pitch, 0.02, atol=1e-6)
    assert np.allclose(yaw, 0.3, atol=1e-6)
    assert np.allclose(hover.rates.values[:, 0], 0.1 * np.cos(hover.rates.t_s), atol=1e-6)
    assert np.allclose(hover.position.values, (1.0, 2.0, -0.5))
    assert np.allclose(hover.velocity.values, (0.1, 0.2, 0.0), atol=1e-6)
    assert hover.servo.values[0, :6].tolist() == [1500, 1510, 1520, 1530, 1490, 0]
    assert np.allclose(hover.thrust_command.values, 0.45)
    (imu,) = hover.imus
    assert np.allclose(imu.specific_force.values, (0.1, -0.2, -9.8), atol=1e-6)
    assert (imu.source, imu.force_step, imu.clipped) == ("HIGHRES_IMU", 0.0, 0)
    assert np.array_equal(imu.gyro.t_s, hover.attitude.t_s)


def test_unstamped_columns_are_placed_within_the_jitter(hover):
    assert sorted(hover.escs) == [1, 2, 3, 4]
    speed = hover.escs[3].rpm
    assert np.all(speed.values == 4020.0)
    assert np.abs(speed.t_s - (40.0 + 0.04 * np.arange(250))).max() < 0.004
    assert hover.escs[1].temperature_c.values[0, 0] == 40.0
    assert hover.battery.values[0].tolist() == [16.8, 20.0]
    assert hover.pressure.values[0].tolist() == [100_000.0, 20.0]
    assert hover.armed[0].end_s == hover.end_s
    assert [i.value for i in hover.modes] == [4]


def test_beams_by_direction_with_a_verdict_each(hover):
    down, right = hover.beam("down"), hover.beam("right")
    assert down.direction_frd == (0.0, 0.0, 1.0)
    assert (down.sigma_m, down.min_m, down.max_m) == (0.01, 0.05, 8.0)
    assert down.share_good == 1.0
    assert np.isnan(right.sigma_m)
    assert right.share_good == pytest.approx(0.9, abs=0.01)
    assert right.verdicts.count(RangeVerdict.ABOVE_MAX) == 17
    assert np.all(right.good.values == 1.2)
    assert hover.beam("up") is None
    assert hover.missing("attitude", "wind", "escs") == ["wind"]


def test_px4_esc_status_and_info(tmp_path):
    (log,) = logs_of(tmp_path, flight(4.0, px4=True))
    assert log.autopilot == 12
    assert sorted(log.escs) == [1, 2, 3, 4]
    assert np.all(log.escs[2].rpm.values == 4010.0)
    assert np.allclose(np.diff(log.escs[2].rpm.t_s), 0.04), "stamped in microseconds"
    assert log.escs[2].temperature_c.values[0, 0] == 41.0


def test_a_reboot_splits_the_log(tmp_path):
    first = flight(5.0, start_ms=100_000)
    second = flight(5.0, start_ms=3_000, arrival_us=EPOCH_US + 20_000_000, armed=False)
    one, two = logs_of(tmp_path, [*first, *second])
    assert (one.boot, two.boot) == (0, 1)
    assert (one.start_s, two.start_s) == (pytest.approx(100.0), pytest.approx(3.0))
    assert len(one.attitude) == len(two.attitude) == 250
    assert one.armed
    assert not two.armed
    assert np.abs(two.escs[1].rpm.t_s - (3.0 + 0.04 * np.arange(125))).max() < 0.004


def test_the_millisecond_wrap_is_not_a_reboot(tmp_path):
    start = 2**32 - 2_000
    messages = [
        (
            EPOCH_US + 20_000 * k,
            frame(mavlink.MAVLink_attitude_message((start + 20 * k) % 2**32, 0, 0, 0, 0, 0, 0)),
        )
        for k in range(200)
    ]
    (log,) = logs_of(tmp_path, [(EPOCH_US, frame(heartbeat())), *messages])
    assert np.allclose(np.diff(log.attitude.t_s), 0.02)
    assert log.attitude.t_s[-1] == pytest.approx((start + 3980) / 1000)


def test_one_damaged_boot_stamp_is_no_reboot(tmp_path):
    messages = flight(4.0)
    wrong = [(EPOCH_US + 2_000_000, frame(mavlink.MAVLink_attitude_message(5, 0, 0, 0, 0, 0, 0)))]
    wrong += [
        (
            EPOCH_US + 3_000_000,
            frame(mavlink.MAVLink_attitude_message(4_000_000_000, 0, 0, 0, 0, 0, 0)),
        )
    ]
    (log,) = logs_of(tmp_path, sorted([*messages, *wrong]))
    assert log.end_s == pytest.approx(43.98)
    assert "impossible boot stamps" in " ".join(log.summary.notes)


def test_a_slow_receiver_clock_does_not_pull_unstamped_messages_away(tmp_path):
    (log,) = logs_of(tmp_path, flight(60.0, drift=1e-4))  # 100 ppm
    assert np.abs(log.escs[1].rpm.t_s - (40.0 + 0.04 * np.arange(1500))).max() < 0.004


def test_two_vehicles_in_one_log(tmp_path):
    both = sorted([*flight(4.0, system=3), *flight(2.0, start_ms=9_000, system=8)])
    (log,) = logs_of(tmp_path, both)
    assert log.system == 3
    assert "also in the log: 8" in " ".join(log.summary.notes)
    (other,) = logs_of(tmp_path, both, target_system=8)
    assert other.start_s == pytest.approx(9.0)
    assert len(other.attitude) == 100


def test_another_component_has_its_own_clock(tmp_path):
    sensor = [
        (EPOCH_US + 20_000 * k + 2_500, frame(
            mavlink.MAVLink_distance_sensor_message(777_000 + 20 * k, 5, 800, 77, 0, 4, 24, 0), 1, 158
        ))
        for k in range(100)
    ]  # fmt: skip
    (log,) = logs_of(tmp_path, sorted([*flight(4.0), *sensor]))
    up = log.beam("up")
    assert (up.component, up.sensor_id) == (158, 4)
    assert up.distance.t_s[0] == pytest.approx(40.0, abs=0.005)


def test_unresolvable_orientation_is_left_out_and_said(tmp_path):
    odd = [
        (
            EPOCH_US + 1,
            frame(mavlink.MAVLink_distance_sensor_message(40_000, 5, 800, 77, 0, 4, 77, 0)),
        )
    ]
    (log,) = logs_of(tmp_path, sorted([*flight(2.0), *odd]))
    assert {b.name for b in log.beams} == {"down", "right"}
    assert "orientation 77 cannot be resolved" in " ".join(log.summary.notes)


@pytest.mark.parametrize("told", [(0,), range(50), (49,)], ids=["the first", "all", "the last"])
def test_a_sensor_with_a_quaternion_looks_where_its_messages_say(told, tmp_path):
    """Orientation 100 with pitch -90 degrees; a message may leave the quaternion out. 65535 cm is nothing."""
    down = (0.5**0.5, 0.0, -(0.5**0.5), 0.0)
    sensor = []
    for k in range(50):
        q = down if k in told else (0.0, 0.0, 0.0, 0.0)
        reading = 65535 if k % 10 == 0 else 150
        message = mavlink.MAVLink_distance_sensor_message(
            40_000 + 20 * k, 10, 400, reading, 0, 4, 100, 0, 0, 0, q, 0
        )
        sensor.append((EPOCH_US + 20_000 * k + 2_500, frame(message)))
    own = [m for m in flight(2.0) if cut(m[1], 0).id != 132]
    (log,) = logs_of(tmp_path, sorted([*own, *sensor]))
    beam = log.beam("down")
    assert (len(beam.distance), len(beam.good)) == (50, 45)
    assert beam.verdicts[10] is RangeVerdict.ABOVE_MAX


def test_clipping_counted_by_the_autopilot_and_seen(tmp_path):
    shakes = [
        (
            EPOCH_US + 100_000 * k,
            frame(
                mavlink.MAVLink_vibration_message(
                    40_000_000 + 100_000 * k, 1, 1, 40, 5 + 3 * k, 0, 0
                )
            ),
        )
        for k in range(20)
    ]
    (log,) = logs_of(tmp_path, sorted([*flight(2.0), *shakes]))
    assert log.imus[0].clipped == 57
    assert log.vibration.values[0].tolist() == [1, 1, 40]


@pytest.mark.parametrize(("fix", "outdoors"), [(1, False), (3, True), (6, True)])
def test_outdoors_is_where_satellites_give_a_place(fix, outdoors, tmp_path):
    fixes = []
    for k in range(10):
        stamp_us = 40_000_000 + 200_000 * k
        message = mavlink.MAVLink_gps_raw_int_message(stamp_us, fix, 0, 0, 0, 100, 100, 0, 0, 9)
        fixes.append((EPOCH_US + 200_000 * k, frame(message)))
    (log,) = logs_of(tmp_path, sorted([*flight(2.0), *fixes]))
    assert log.gps_fix.values[:, 0].tolist() == [fix] * 10
    assert under_open_sky(log) is outdoors


def test_without_satellites_nothing_says_outdoors(tmp_path):
    (log,) = logs_of(tmp_path, flight(2.0))
    assert log.gps_fix is None
    assert not under_open_sky(log)


def test_raw_imu_is_seen_to_be_quantised_and_comes_second(tmp_path):
    raw = [
        (EPOCH_US + 20_000 * k, frame(
            mavlink.MAVLink_raw_imu_message(40_000_000 + 20_000 * k, k % 7, -k % 5, -1000 + k % 3, 0, 0, 0, 0, 0, 0)
        ))
        for k in range(100)
    ]  # fmt: skip
    (log,) = logs_of(tmp_path, sorted([*flight(2.0), *raw]))
    assert [i.source for i in log.imus] == ["HIGHRES_IMU", "RAW_IMU"]
    assert log.imus[1].force_step == pytest.approx(9.80665e-3)


def test_rangefinder_alone_and_beside_a_coarse_sensor(tmp_path):
    fine = [
        (
            EPOCH_US + 20_000 * k + 2_000,
            frame(mavlink.MAVLink_rangefinder_message(0.5 + 0.001 * (k % 5), 0)),
        )
        for k in range(200)
    ]
    (log,) = logs_of(tmp_path, sorted([*flight(4.0), *fine]))
    assert log.beam("down").source == "RANGEFINDER", "the same quantity, finer and faster"
    assert log.beam("down").max_m == 8.0
    other = [
        (a, frame(mavlink.MAVLink_rangefinder_message(3.0 + 0.001 * (k % 5), 0)))
        for k, (a, _) in enumerate(fine)
    ]
    (log,) = logs_of(tmp_path, sorted([*flight(4.0), *other]))
    assert log.beam("down").source == "DISTANCE_SENSOR", "another quantity"
    (log,) = logs_of(tmp_path, [m for m in sorted([*flight(4.0), *fine]) if cut(m[1], 0).id != 132])
    assert log.beam("down").source == "RANGEFINDER"
    assert log.beam("up") is None


def test_repeated_esc_telemetry_is_no_news_and_an_absent_esc_no_esc(tmp_path):
    kind = mavlink.MAVLink_esc_telemetry_5_to_8_message
    stuck = [
        (EPOCH_US + 20_000 * k, frame(
            kind([30] * 4, [0] * 4, [0] * 4, [0] * 4, [3000, 0, 0, 0], [k // 5, 0, 0, 0])
        ))
        for k in range(100)
    ]  # fmt: skip
    (log,) = logs_of(tmp_path, sorted([*flight(2.0), *stuck]))
    assert sorted(log.escs) == [1, 2, 3, 4, 5]
    assert len(log.escs[5].rpm) == 20


def test_no_time_axis_is_one_line(tmp_path):
    with pytest.raises(LogError, match="no time axis"):
        logs_of(tmp_path, [(EPOCH_US + k, frame(heartbeat())) for k in range(5)])


def test_series_at():
    s = Series(np.array([0.0, 1.0, 3.0]), np.array([[0.0], [10.0], [30.0]]))
    assert s.at(np.array([-1.0, 0.0, 0.5, 2.0, 3.0, 4.0]))[:, 0].tolist()[1:5] == [
        0.0,
        5.0,
        20.0,
        30.0,
    ]
    assert np.isnan(s.at(np.array([-1.0, 4.0]))).all()
    assert np.isnan(s.at(np.array([2.0]), max_gap_s=1.5)).all()
    assert s.at(np.array([0.9, 2.9, 3.5]), hold=True)[:, 0].tolist() == [0.0, 10.0, 30.0]
    assert np.isnan(s.at(np.array([2.9]), 1.0, hold=True)).all()
    assert len(s.between(0.5, 3.0)) == 1
    empty = Series(np.empty(0), np.empty((0, 2)))
    assert np.isnan(empty.at(np.array([1.0]))).all()
    one = Series(np.array([1.0]), np.array([[5.0]]))
    assert one.at(np.array([1.0]))[0, 0] == 5.0


@given(st.lists(st.tuples(st.floats(0, 1e6), st.floats(-1e3, 1e3)), min_size=1, max_size=30))
def test_tidy_is_strictly_increasing(pairs):
    t, v = (np.array(x) for x in zip(*pairs, strict=True))
    series = tidy(t, v, "x")
    assert (np.diff(series.t_s) > 0).all()
    assert set(series.t_s) == set(t)


def test_small_helpers():
    assert smallest_step(0.1 * np.array([1, 2, 5, 9, 12, 13, 20, 31, 32, 40, 44])) == pytest.approx(
        0.1
    )
    assert smallest_step(np.array([0.1, -0.2, -9.8])) == 0.0
    assert smallest_step(np.random.default_rng(0).normal(size=500)) == 0.0
    assert direction_name((0.0, 0.17, 0.985)) == "down"
    assert direction_name((0.7, 0.0, 0.7)) == "other"
    q = np.array([[1.0, 0, 0, 0], [-1.0, 0, 0, 0], [0.0, 0, 0, 0], [-1.0, 0, 0, 0]])
    out = unflipped(q)
    assert out[1, 0] == out[3, 0] == 1.0
    assert np.isnan(out[2]).all()


def test_against_the_known_truth_of_a_recorded_autopilot(shared_data):
    """Boot clock and NED of a real autopilot's recording against its simulator (README: truth t = boot - 5 ms)."""
    folder = shared_data / "ardupilot"
    (log,) = load(folder / "s1_quad3_ground_wall_corner.tlog")
    counts = json.loads((folder / "s1_quad3_ground_wall_corner.json").read_text())
    assert counts["time_alignment"]["truth_t_minus_boot_s"] == -0.005
    truth = np.genfromtxt(
        folder / "s1_quad3_ground_wall_corner.truth.csv", delimiter=",", names=True
    )
    names = truth.dtype.names
    t = truth[names[0]] + 0.005
    columns = [
        next(n for n in names if n.lower() in options) for options in (("n", "north", "pn", "x"),)
    ]
    north = log.position.at(t, 0.1)[:, 0]
    good = np.isfinite(north)
    assert good.mean() > 0.8
    error = north[good] - truth[columns[0]][good]
    assert np.std(error) < 0.05
    assert sorted(log.escs) == [1, 2, 3, 4]
    assert {b.name for b in log.beams} >= {"down", "forward"}
    assert log.parameters["GUID_OPTIONS"] == 0.0


def test_the_clipped_accelerometer_of_a_real_flight_is_flagged(shared_data):
    (log,) = load(shared_data / "open" / "tlog_bruno_20211202-132614.tlog")
    assert next(i for i in log.imus if i.source == "RAW_IMU").clipped == 6311


def test_the_reboot_in_a_real_log_is_found(shared_data):
    first, second = load(shared_data / "open" / "tlog_dronekit_python_flight.tlog")
    assert first.end_s > second.start_s
    assert not first.armed
    assert len(second.armed) >= 3
    assert len(second.parameters) == 491
