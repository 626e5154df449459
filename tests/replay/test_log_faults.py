"""Every kind of fault of a log or vehicle file: made in a simulated flight, found, said, and left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rigid_flight import Motion, fly, logged, speeds, with_speed

from companion.mavlink.samples import RangeVerdict
from companion.vehicles import QUAD
from models.vehicle import Fan, Rotor, Throttle, Vehicle, load_vehicle
from replay.diagnosis.diagnose import conclude
from replay.diagnosis.model_faults import model_faults
from replay.flightlog import FlightLog, LogFault, Series
from replay.residual.motion_faults import derived_accelerometer
from replay.residual.record import build_record
from replay.residual.vehicle_faults import exchanged_fans, exchanged_spins

QUADROTOR = load_vehicle(QUAD)
FORCES, ALL = (0, 1, 2), (0, 1, 2, 3, 4, 5)


@pytest.fixture(scope="module")
def flown() -> Motion:
    return fly(QUADROTOR)


def by_outputs(vehicle: Vehicle = QUADROTOR) -> Vehicle:
    """The same vehicle, its thrust declared by servo outputs as ``logged`` writes them: a quadratic curve."""
    fans = tuple(
        replace(f, rotors=tuple(Rotor(r.spin, servo=r.esc) for r in f.rotors)) for f in vehicle.fans
    )
    most = vehicle.mass_kg * 9.80665 / len(fans) / 0.45**2
    return replace(
        vehicle,
        fans=fans,
        throttle=Throttle(
            max_thrust_n=most, expo=1.0, pwm_min_us=1000.0, pwm_max_us=2000.0, voltage_v=16.0
        ),
    )


def fans_at(places: tuple[int, ...]) -> Vehicle:
    """The quadrotor with fan ``k`` declared where fan ``places[k]`` is."""
    fans = QUADROTOR.fans
    moved = tuple(
        replace(f, position_m=fans[p].position_m) for f, p in zip(fans, places, strict=True)
    )
    return replace(QUADROTOR, fans=moved)


def spun(fan: Fan) -> Fan:
    """A fan that turns the other way."""
    return replace(fan, rotors=tuple(replace(r, spin=-r.spin) for r in fan.rotors))


def imu(log: FlightLog, force: Callable | None = None, gyro: Callable | None = None) -> FlightLog:
    """The log with an accelerometer or gyro that reads otherwise."""
    old = log.imus[0]

    def other(series: Series, change: Callable | None) -> Series:
        return series if change is None else replace(series, values=change(series.values))

    return replace(
        log,
        imus=(
            replace(
                old, specific_force=other(old.specific_force, force), gyro=other(old.gyro, gyro)
            ),
        ),
    )


def servo(log: FlightLog, change: Callable) -> FlightLog:
    assert log.servo is not None
    return replace(log, servo=replace(log.servo, values=change(log.servo.values)))


@dataclass(frozen=True)
class Fault:
    """How it is made, what is said, and which axes can still be judged."""

    make: Callable[[FlightLog], FlightLog]
    channel: str
    words: str
    axes: tuple[int, ...]
    vehicle: Vehicle = QUADROTOR


def exchanged(log: FlightLog) -> FlightLog:
    one, three = speeds(log, 1), speeds(log, 3)
    return with_speed(with_speed(log, 1, three), 3, one)


def copied(log: FlightLog) -> FlightLog:
    mean = np.mean([speeds(log, k) for k in (1, 2, 3, 4)], axis=0)
    for k in (1, 2, 3, 4):
        log = with_speed(log, k, mean)
    return log


def five(log: FlightLog) -> FlightLog:
    return replace(log, escs={**log.escs, 5: log.escs[4]})


def frozen_range(log: FlightLog) -> FlightLog:
    (beam,) = log.beams
    still = replace(beam.distance, values=np.full_like(beam.distance.values, 2.0))
    return replace(log, beams=(replace(beam, distance=still),))


def derived(log: FlightLog) -> FlightLog:
    """The specific force as somebody would compute it who has no accelerometer."""
    from models.common.frames import rotation_from_quaternion

    assert log.attitude is not None
    assert log.velocity is not None
    t, v = log.velocity.t_s, log.velocity.values
    padded = np.pad(v, ((2, 2), (0, 0)), "edge")
    smooth = np.stack(
        [np.convolve(padded[:, a], np.ones(5) / 5.0, "valid") for a in range(3)], axis=1
    )
    rate = np.gradient(smooth, t, axis=0) - np.array([0.0, 0.0, 9.81])
    rotation = rotation_from_quaternion(log.attitude.values)
    return imu(log, force=lambda _: np.einsum("nji,nj->ni", rotation, rate))


def on_its_side(x: np.ndarray) -> np.ndarray:
    return x[:, [2, 1, 0]]


def frozen_z(x: np.ndarray) -> np.ndarray:
    out = x.copy()
    out[:, 2] = -9.81
    return out


def slow(log: FlightLog) -> FlightLog:
    for k in (1, 2, 3, 4):
        old = log.escs[k].rpm
        assert old is not None
        log = replace(
            log,
            escs={**log.escs, k: replace(log.escs[k], rpm=Series(old.t_s[::18], old.values[::18]))},
        )
    return log


def at_the_stop(log: FlightLog) -> FlightLog:
    def stopped(values: np.ndarray) -> np.ndarray:
        out = values.copy()
        out[: len(out) * 3 // 10, 1] = 2000.0
        return out

    return servo(log, stopped)


def test_yaw_that_follows_the_torque_at_once_and_opposes_it_later_is_no_exchanged_spin():
    """A lively yaw loop swings: half a swing later everything has the other sign."""
    t = np.arange(6000) / 100.0
    swing = 2.0 * np.pi * 5.0
    turned = np.outer(np.sin(swing * t) / swing, [0.0, 0.0, 1.0])

    def found(sign: float) -> list[LogFault]:
        # Rotor speeds that arrive 30 ms late: what was turned comes before its torque.
        moment = np.outer(sign * np.cos(swing * (t - 0.03)), [0.0, 0.0, 0.1])
        ctx = SimpleNamespace(rotor_moment=moment, weight=30.0, lever=0.3)
        motion = SimpleNamespace(grid=SimpleNamespace(rate=100.0), gyro=turned)
        return exchanged_spins(ctx, motion, np.ones(len(t), bool))

    assert found(1.0) == []


def rarely_logged(log: FlightLog) -> FlightLog:
    """The log as a dataflash log of common settings holds it: IMU at 25 Hz, attitude at 10 Hz."""

    def thin(series: Series, every: int) -> Series:
        return replace(series, t_s=series.t_s[::every], values=series.values[::every])

    one = log.imus[0]
    slower = replace(one, specific_force=thin(one.specific_force, 4), gyro=thin(one.gyro, 4))
    assert log.attitude is not None
    return replace(log, imus=(slower,), attitude=thin(log.attitude, 10))


def test_a_moment_of_the_air_that_rocks_the_vehicle_is_no_exchange_of_fans():
    """The rotors hold against it, a little late: slowly the vehicle turns the other way than they push.

    Yaw is held beside it, so that with two fans exchanged they would push the way it turns.
    """
    rng = np.random.default_rng(5)
    time_s = np.arange(4500) / 50.0
    places = np.array([fan.position_m[:2] for fan in QUADROTOR.fans])
    rocking = 0.3 * np.sin(2.0 * np.pi * 0.47 * time_s)
    noise = 0.1 * rng.standard_normal((2, len(time_s)))
    roll, pitch = (np.convolve(one, np.ones(5) / 5.0, "same") for one in noise)
    held = roll - np.roll(rocking, 5)
    turned = np.column_stack([held + rocking, pitch, 0.0 * time_s])
    # The thrusts that make roll -y T and pitch x T, and those that make yaw alone.
    arms = np.stack([-places[:, 1], places[:, 0]], axis=1)
    of_yaw = np.array([1.0, 1.0, -1.0, -1.0])
    thrust = np.column_stack([held, pitch]) @ np.linalg.pinv(arms)
    thrust += 0.5 * turned[:, :1] * of_yaw
    ctx = SimpleNamespace(vehicle=QUADROTOR, thrust=thrust, weight=30.0, lever=0.3)
    gyro = np.cumsum(turned, axis=0) / 50.0
    motion = SimpleNamespace(grid=SimpleNamespace(rate=50.0), gyro=gyro)
    assert exchanged_fans(ctx, motion, np.ones(len(time_s), bool)) == []


@pytest.mark.parametrize(
    ("rounded_m_s2", "offset_m_s2", "is_derived"),
    [(0.001, 0.0, True), (0.01, 0.0, True), (0.001, 0.02, False)],
)
def test_a_derivative_that_only_differs_by_rounding_is_no_accelerometer(
    rounded_m_s2: float, offset_m_s2: float, is_derived: bool
) -> None:
    """At the rate of its velocity nothing is smoothed. An accelerometer's offset wanders with its temperature."""
    rng = np.random.default_rng(3)
    time_s = np.arange(3000) / 10.0
    rounding = rounded_m_s2 * (rng.random((3000, 3)) - 0.5)
    wandering = offset_m_s2 * np.sin(2.0 * np.pi * time_s / 100.0)
    motion = SimpleNamespace(
        grid=SimpleNamespace(rate=10.0),
        rotation=np.broadcast_to(np.eye(3), (3000, 3, 3)),
        kinematic_bias=rounding + wandering[:, None],
    )
    assert derived_accelerometer(motion, np.ones(3000, bool)) is is_derived


def test_a_frame_that_shakes_faster_than_it_is_logged_has_no_faulty_gyro(flown: Motion) -> None:
    hertz, share = 2.0 * np.pi * 22.3, np.array([1.0, 0.7, 0.2])
    turned, rate = (1.5 * f(hertz * flown.t)[:, None] * share for f in (np.sin, np.cos))
    half = np.column_stack([np.ones(len(flown.t)), turned / hertz / 2.0])
    w, x, y, z = flown.quaternion.T
    product = np.stack([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    frame = replace(
        flown, quaternion=np.einsum("ijn,nj->ni", product, half), rates=flown.rates + rate
    )
    shaken = logged(frame, QUADROTOR, Path("a.tlog"))
    assert not build_record(rarely_logged(shaken), QUADROTOR, None).faults
    dead = imu(shaken, gyro=lambda g: g * np.array([0.0, 1.0, 1.0]))
    assert [f.channel for f in build_record(rarely_logged(dead), QUADROTOR, None).faults] == [
        "p_rad_s"
    ]


def test_fans_exchanged_in_a_calm_flight_are_found(flown):
    """Small moments stand beside noise: the right order need not fit well, only far better than the declared one."""
    rng = np.random.default_rng(4)

    def noisy(gyro):
        return gyro + 0.15 * rng.standard_normal(gyro.shape)

    log = imu(logged(flown, QUADROTOR, Path("a.tlog")), gyro=noisy)
    assert build_record(log, QUADROTOR, None).faults == ()
    (fault,) = build_record(log, fans_at((1, 0, 2, 3)), None).faults
    assert "fans 1 and 2 are exchanged" in fault.what


KINDS = {
    "dead rotor speed": Fault(lambda g: with_speed(g, 1, 0.0 * speeds(g, 1)), "rpm_1", "reads 0 rpm", (0, 1)),
    "stuck rotor speed": Fault(
        lambda g: with_speed(g, 2, np.full(len(speeds(g, 2)), 4500.0)), "rpm_2", "stays at 4500 rpm", (0, 1)
    ),
    "speed of other poles": Fault(
        lambda g: with_speed(g, 3, 2.0 * speeds(g, 3)), "rpm_3", "2 times the other rotors'", (0, 1)
    ),
    "electrical speed of all": Fault(
        lambda g: with_speed(with_speed(with_speed(with_speed(
            g, 1, 7.0 * speeds(g, 1)), 2, 7.0 * speeds(g, 2)), 3, 7.0 * speeds(g, 3)), 4, 7.0 * speeds(g, 4)),
        "rpm_1", "m/s at the tip", (0, 1),
    ),
    "exchanged rotor speeds": Fault(
        exchanged, "vehicle file", "fans 1 and 3 are exchanged", FORCES
    ),
    "copies of one speed": Fault(copied, "rpm_1", "copies of one number", FORCES),
    "a rotor that the file lacks": Fault(five, "rpm_5", "knows no such rotor", (0, 1)),
    "slow rotor speeds": Fault(slow, "rpm_1", "comes at 2.8 Hz", FORCES),
    "left and right mirrored": Fault(lambda g: g, "vehicle file", "left and right", FORCES, fans_at((2, 3, 0, 1))),
    "front and back mirrored": Fault(lambda g: g, "vehicle file", "front and back", FORCES, fans_at((3, 2, 1, 0))),
    "diagonal arms exchanged": Fault(lambda g: g, "vehicle file", "fans 1 and 2", FORCES, fans_at((1, 0, 2, 3))),
    "turned by a quarter": Fault(lambda g: g, "vehicle file", "front and", FORCES, fans_at((3, 2, 0, 1))),
    "spins exchanged": Fault(
        lambda g: g, "vehicle file", "clockwise and counter-clockwise", FORCES,
        replace(QUADROTOR, fans=tuple(spun(f) for f in QUADROTOR.fans)),
    ),
    "file of a heavier vehicle": Fault(
        lambda g: g, "vehicle file", "times the lift that flew", (0, 1), replace(QUADROTOR, mass_kg=9.0)
    ),
    "reversed gyro": Fault(lambda g: imu(g, gyro=lambda x: -x), "p_rad_s", "disagrees", FORCES),
    "dead gyro": Fault(lambda g: imu(g, gyro=lambda x: 0.0 * x), "q_rad_s", "disagrees", FORCES),
    "IMU on its side": Fault(lambda g: imu(g, force=on_its_side), "ax_m_s2", "disagrees", (1, 3, 4, 5)),
    "frozen accelerometer axis": Fault(lambda g: imu(g, force=frozen_z), "az_m_s2", "disagrees", (0, 1, 3, 4, 5)),
    "derived accelerometer": Fault(derived, "ax_m_s2", "computed from the velocity", ALL),
    "range that never moves": Fault(frozen_range, "range_down_m", "stays at 2.00 m", ALL),
    "copies of one output": Fault(
        lambda g: servo(g, lambda x: np.repeat(x[:, :1], 16, axis=1)), "servo_1", "copies of one number", FORCES,
        by_outputs(),
    ),
    "output at full command": Fault(at_the_stop, "servo_2", "at full command in 30% of the flight", ALL, by_outputs()),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_a_fault_is_found_said_and_left_out(kind, flown):
    fault = KINDS[kind]
    record = build_record(
        fault.make(logged(flown, QUADROTOR, Path(f"{kind}.tlog"))), fault.vehicle, None
    )
    said = [f.what for f in record.faults if f.channel == fault.channel]
    assert any(fault.words in what for what in said), record.faults
    assert record.axes == fault.axes
    left = [a for a in range(6) if a not in record.axes and a not in record.blind]
    assert np.all(record.residual[record.valid][:, left] == 0.0)


def test_a_lift_that_never_flew_is_said_once(flown):
    """A log whose lift is not judged at all is not told again how far the model is from it."""
    log = logged(flown, QUADROTOR, Path("a.tlog"))
    heavier, heavy = (
        replace(QUADROTOR, mass_kg=1.8 * QUADROTOR.mass_kg),
        replace(QUADROTOR, mass_kg=9.0),
    )
    for vehicle in (heavy, heavier):
        record = build_record(log, vehicle, None)
        said = [f.what for f in record.faults] + [f["what"] for f in model_faults([record], None)]
        assert sum("times the lift that flew" in what for what in said) == 1, said


def test_a_short_flight_mostly_at_full_command_is_judged_and_time_left_out_has_its_reason(flown):
    """Of twelve seconds five are left: too few to judge alone, so all of them count and the fault is said."""

    def first_seconds(log: FlightLog, seconds: float) -> FlightLog:
        def cut(series: Series | None) -> Series | None:
            return (
                None
                if series is None
                else Series(*(x[series.t_s < seconds] for x in (series.t_s, series.values)))
            )

        (one,) = log.imus
        return replace(
            log, attitude=cut(log.attitude), rates=cut(log.rates), position=cut(log.position),
            velocity=cut(log.velocity), servo=cut(log.servo),
            imus=(replace(one, specific_force=cut(one.specific_force), gyro=cut(one.gyro)),),
            escs={k: replace(e, rpm=cut(e.rpm)) for k, e in log.escs.items()},
        )  # fmt: skip

    log = logged(flown, QUADROTOR, Path("a.tlog"))
    record = build_record(at_the_stop(log), by_outputs(), None)
    assert {e.reason: e.seconds for e in record.excluded}["at full command"] > 10.0
    short = first_seconds(log, 16.0)
    assert short.servo is not None
    values = short.servo.values.copy()
    values[len(values) * 55 // 100 :, 1] = 2000.0
    record = build_record(
        replace(short, servo=replace(short.servo, values=values)), by_outputs(), None
    )
    assert any("at full command" in f.what for f in record.faults)
    assert "at full command" not in {e.reason for e in record.excluded}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_no_fault_of_the_log_is_named_as_an_effect_of_the_vehicle(kind, flown):
    """Nothing acts in the flight but what the vehicle file says."""
    fault = KINDS[kind]
    answer = conclude(
        [build_record(fault.make(logged(flown, QUADROTOR, Path("a.tlog"))), fault.vehicle, None)]
    )
    assert [n.effect.name for n in answer.found] == []
    assert answer.verdict != "explained"


@pytest.mark.parametrize("vehicle", [QUADROTOR, by_outputs()], ids=["by speeds", "by outputs"])
@pytest.mark.parametrize("seed", range(3))
def test_a_clean_flight_has_no_fault(vehicle, seed, flown):
    record = build_record(logged(flown, QUADROTOR, Path("clean.tlog"), seed=seed), vehicle, None)
    assert record.faults == ()
    assert record.axes == ALL


def test_after_a_crash_nothing_is_judged(flown):
    """Upside down at the end, rotors running."""
    log = logged(flown, QUADROTOR, Path("a.tlog"))
    assert log.attitude is not None
    over = log.attitude.values.copy()
    over[3000:] = over[3000:][:, [1, 0, 3, 2]] * np.array([-1.0, 1.0, -1.0, 1.0])
    record = build_record(
        replace(log, attitude=replace(log.attitude, values=over)), QUADROTOR, None
    )
    assert any("upside down from 40 s" in f.what for f in record.faults)
    assert not record.valid[record.time_s > 39.0].any()
    assert record.valid[record.time_s < 38.0].mean() > 0.9


def ended_on_the_ground(flown: Motion, rest_s: float = 15.0, off_s: float = 0.0) -> FlightLog:
    """After the flight the vehicle stands, its rotors between half and full lift; then they stop for ``off_s``."""
    n, m = int(rest_s * 100), int(off_s * 100)
    rng = np.random.default_rng(3)

    def held(x: np.ndarray, value: np.ndarray) -> np.ndarray:
        return np.concatenate([x, np.repeat(value[None], n + m, axis=0)])

    t = np.arange(len(flown.t) + n + m) / 100.0
    wander = np.stack(
        [np.convolve(rng.standard_normal(n), np.ones(60) / 8.0, "same") for _ in range(4)], axis=1
    )
    running = flown.speed.mean(axis=0) * (0.85 + 0.03 * wander)
    ground = Motion(
        t, held(flown.quaternion, np.array([1.0, 0.0, 0.0, 0.0])), held(flown.rates, np.zeros(3)),
        held(flown.position, np.array([0.0, 0.0, -0.2])), held(flown.velocity, np.zeros(3)),
        held(flown.force, np.array([0.0, 0.0, -9.80665])),
        np.concatenate([flown.speed, running, np.zeros((m, 4))]),
    )  # fmt: skip
    return logged(ground, QUADROTOR, Path("landed.tlog"))


@pytest.mark.parametrize("off_s", [0.0, 5.0], ids=["log ends with rotors running", "rotors stop"])
def test_standing_on_the_ground_with_turning_rotors_is_no_flight(flown, off_s):
    record = build_record(ended_on_the_ground(flown, off_s=off_s), QUADROTOR, None)
    assert not record.valid[record.time_s > 51.0].any()
    assert record.valid[record.time_s < 49.0].mean() > 0.95


def test_gaps_of_stitched_flights_are_left_out_and_said(flown):
    log = logged(flown, QUADROTOR, Path("a.tlog"))

    def cut(series: Series | None) -> Series:
        assert series is not None
        keep = (series.t_s < 22.0) | (series.t_s > 25.0)
        return Series(series.t_s[keep], series.values[keep], series.source)

    (one,) = log.imus
    gappy = replace(
        log, attitude=cut(log.attitude), rates=cut(log.rates), position=cut(log.position), velocity=cut(log.velocity),
        imus=(replace(one, specific_force=cut(one.specific_force), gyro=cut(one.gyro)),),
        escs={k: replace(e, rpm=cut(e.rpm)) for k, e in log.escs.items()},
    )  # fmt: skip
    record = build_record(gappy, QUADROTOR, None)
    gap = sum(e.seconds for e in record.excluded if "gap in the log" in e.reason)
    assert gap == pytest.approx(3.0, abs=0.2)
    assert record.faults == ()
    assert not record.valid[(record.time_s > 22.1) & (record.time_s < 24.9)].any()


def test_a_range_that_holds_still_with_the_vehicle_is_no_fault(flown):
    """Hovering at one height the range does not move, and must not."""
    log = logged(
        replace(flown, position=flown.position * np.array([1.0, 1.0, 0.01])),
        QUADROTOR,
        Path("a.tlog"),
    )
    (beam,) = log.beams
    still = Series(beam.distance.t_s, np.full_like(beam.distance.values, 2.0))
    held = replace(
        log, beams=(replace(beam, distance=still, verdicts=(RangeVerdict.OK,) * len(still)),)
    )
    assert build_record(held, QUADROTOR, None).faults == ()


def test_roll_that_the_loop_opposes_is_no_mirrored_fan():
    """Something rocks the vehicle, and the rotors hold against it: they oppose what turned it some time before."""
    t = np.arange(6000) / 100.0
    swing = 2.0 * np.pi * 1.1
    flicker = 2.0 * np.pi * 3.0

    def found(delay_s: float) -> list[LogFault]:
        roll = -0.3 * np.cos(swing * (t + delay_s))
        pitch = 0.3 * np.cos(flicker * (t + 0.02))
        places = np.array([fan.position_m for fan in QUADROTOR.fans])
        lift = np.outer(roll, -places[:, 1]) + np.outer(pitch, places[:, 0])
        ctx = SimpleNamespace(vehicle=QUADROTOR, thrust=10.0 + lift, weight=30.0, lever=0.3)
        turned = (np.sin(swing * t), np.sin(flicker * t) * swing / flicker, np.zeros_like(t))
        motion = SimpleNamespace(grid=SimpleNamespace(rate=100.0), gyro=np.stack(turned, axis=1))
        return exchanged_fans(ctx, motion, np.ones(len(t), bool))

    assert len(found(0.05)) == 1
    assert found(0.25) == []


def test_yaw_that_the_loop_opposes_is_no_exchanged_spin():
    """Rotors that damp a swing oppose the angular acceleration a quarter of a period later, not at once."""
    t = np.arange(6000) / 100.0
    swing = 2.0 * np.pi * 1.1
    gyro = np.outer(np.sin(swing * t), [0.0, 0.0, 0.3])

    def opposed(delay_s: float) -> list[LogFault]:
        moment = np.outer(-np.cos(swing * (t + delay_s)), [0.0, 0.0, 0.1])
        ctx = SimpleNamespace(rotor_moment=moment, weight=30.0, lever=0.3)
        motion = SimpleNamespace(grid=SimpleNamespace(rate=100.0), gyro=gyro)
        return exchanged_spins(ctx, motion, np.ones(len(t), bool))

    assert len(opposed(0.05)) == 1
    assert opposed(0.3) == []


def test_an_accelerometer_that_take_off_and_landing_disturb_is_not_faulty(flown: Motion) -> None:
    """The first and the last eight of forty seconds shake az by more than the flight moves it."""
    ends = (flown.t < 8.0) | (flown.t > 32.0)

    def shaken(x: np.ndarray) -> np.ndarray:
        out = x.copy()
        out[:, 2] += np.where(ends, 4.0 * np.sin(2.0 * np.pi * 0.5 * flown.t), 0.0)
        return out

    log = logged(flown, QUADROTOR, Path("flight.ulg"))
    record = build_record(imu(log, force=shaken), QUADROTOR, None)
    assert 2 in record.axes
    assert "az_m_s2" not in {f.channel for f in record.faults}
