"""Measured minus modelled wrench of a flight on one clock: delays first, one filter for both, bad time left out."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.mavlink.messages import RangeVerdict, orientation_direction
from models.air_state import DIRECTIONS, AirState
from models.effects import AdoptedEffect, Context, adopted_wrench, corrected_state
from models.errors import ConfigError, LogError
from models.frames import GRAVITY, Array, measured_wrench, rotation_from_quaternion
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle
from models.vehicle_wrench import modelled_wrench
from replay.flightlog import Beam, FlightLog, ImuRecord, Series

Mask = NDArray[np.bool_]

RATE_HZ = 10.0
CUT_OFF_HZ = 2.0
MOMENT_RATE_HZ = 20.0
FORCE_RATE_HZ = 4.0
MAX_GAP_S = 0.5
MAX_INCIDENCE_COS = float(np.cos(np.radians(30.0)))
LONGEST_DELAY_S = 0.3
FILTER_DELAY_S = 0.035
AIRBORNE_SHARE = 0.5
SHORTEST_S = 12.0
COMMANDED = 0.6
"""Correlation of lift with the accelerometer below which rotor speeds mostly answer noise, and motions are drift."""


@dataclass(frozen=True)
class Delay:
    """How late a signal is stamped [s], and how well that is known (correlation at the best lag)."""

    signal: str
    seconds: float
    correlation: float
    corrected: bool


@dataclass(frozen=True)
class Excluded:
    """Time left out of the analysis, and why."""

    reason: str
    seconds: float


@dataclass(frozen=True)
class Record:
    """One flight, ready to be searched: rows on a uniform clock, smoothed alike.

    ``residual`` (n, 6) in N and N m; ``valid`` (n,); ``axes`` the axes that this log can judge.
    ``kinematic_bias`` (n, 3): accelerometer minus the specific force that velocity and attitude imply, body FRD.
    """

    name: str
    log: FlightLog
    context: Context
    residual: Array
    measured: Array
    valid: Mask
    axes: tuple[int, ...]
    step_s: float
    kinematic_bias: Array
    channels: dict[str, Array]
    delays: tuple[Delay, ...]
    excluded: tuple[Excluded, ...]
    notes: tuple[str, ...] = field(default=())

    @property
    def time_s(self) -> Array:
        """(n,)."""
        return self.context.state.time_s

    @property
    def only_answers(self) -> bool:
        """Whether rotor speeds mostly answer noise, as in a flight that only hovers (``delays[0]`` is theirs)."""
        return bool(self.delays) and self.delays[0].correlation < COMMANDED

    @property
    def seconds(self) -> float:
        """Time that was judged."""
        return float(self.valid.sum() * self.step_s)


class _Grid:
    """Raw samples on a uniform clock, and the smoother that every signal goes through."""

    def __init__(self, start: float, end: float, rate: float, cut_off_hz: float) -> None:
        self.rate = rate
        self.t = start + np.arange(max(int((end - start) * rate), 1)) / rate
        sigma = 0.1325 / cut_off_hz * rate  # Gaussian: -3 dB at 0.1325/sigma_t
        half = max(int(4 * sigma), 1)
        kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / sigma) ** 2)
        self.kernel = kernel / kernel.sum()
        self.every = max(round(rate / RATE_HZ), 1)

    def smooth(self, x: Array) -> Array:
        """Zero-phase Gaussian low-pass of (n, ...) along time, NaN ignored, every n-th sample kept."""
        flat = x.reshape(len(x), -1)
        out = np.empty((len(range(0, len(x), self.every)), flat.shape[1]))
        weight_all = None
        for k in range(flat.shape[1]):
            known = np.isfinite(flat[:, k])
            if known.all():
                if weight_all is None:
                    weight_all = np.convolve(np.ones(len(x)), self.kernel, "same")
                weight, y = weight_all, flat[:, k]
            else:
                weight, y = np.convolve(known.astype(float), self.kernel, "same"), np.where(known, flat[:, k], 0.0)
            total = np.convolve(y, self.kernel, "same")
            with np.errstate(invalid="ignore", divide="ignore"):
                out[:, k] = np.where(weight > 0.4, total / weight, np.nan)[:: self.every]
        return out.reshape(-1, *x.shape[1:])

    def pick(self, x: Any) -> Any:
        """Every n-th sample, unsmoothed."""
        return x[:: self.every]


def build_record(
    log: FlightLog,
    vehicle: Vehicle,
    model: FanSurrogate | None,
    effects: tuple[AdoptedEffect, ...] = (),
    name: str = "",
) -> Record:
    """The residual of one flight. Raises LogError in one line where the log lacks what is needed."""
    imu = _imu(log)
    assert log.attitude is not None
    start = max(imu.specific_force.t_s[0], log.attitude.t_s[0])
    end = min(imu.specific_force.t_s[-1], log.attitude.t_s[-1])
    if end - start < SHORTEST_S:
        raise LogError(
            f"{log.path}: only {max(end - start, 0.0):.0f} s with IMU and attitude; record {SHORTEST_S:.0f} s at least"
        )
    notes: list[str] = []
    rate = min(imu.specific_force.rate_hz, 100.0)
    if rate < FORCE_RATE_HZ:
        raise LogError(
            f"{log.path}: {imu.source} at {rate:.1f} Hz is too slow for forces; ask for {FORCE_RATE_HZ:.0f} Hz or more"
        )
    grid = _Grid(start, end, rate, min(CUT_OFF_HZ, rate / 4.0))
    t = grid.t
    force = imu.specific_force.at(t, MAX_GAP_S)
    gyro_series = imu.gyro if len(imu.gyro) and np.isfinite(imu.gyro.values).any() else log.rates
    gyro = gyro_series.at(t, MAX_GAP_S) if gyro_series is not None else np.full((len(t), 3), np.nan)
    axes = list(range(6))
    gyro_rate = 0.0 if gyro_series is None else gyro_series.rate_hz
    if gyro_rate < MOMENT_RATE_HZ:
        axes = [0, 1, 2]
        notes.append(f"gyro at {gyro_rate:.0f} Hz: too slow for moments ({MOMENT_RATE_HZ:.0f} Hz needed), forces only")
    elif vehicle.throttle is not None and _equal_outputs(log, vehicle):
        axes = [0, 1, 2]
        notes.append("all servo outputs are copies of one number: moments cannot be judged, forces only")
    rotation = rotation_from_quaternion(_unit(log.attitude.at(t, MAX_GAP_S)))
    position = log.position.at(t, 1.0) if log.position is not None else np.full((len(t), 3), np.nan)
    velocity = log.velocity.at(t, 1.0) if log.velocity is not None else np.full((len(t), 3), np.nan)
    state = _raw_state(log, vehicle, t, force, gyro, rotation, position, velocity)
    context = Context(state, vehicle, model)
    rpm_delay = _rotor_delay(context, grid)
    delays = [rpm_delay]
    range_delay = _range_delay(log, vehicle, t, rotation, velocity, position)
    if range_delay is not None:
        delays.append(range_delay)
    state = replace(
        state,
        **_rotors(log, vehicle, t, rpm_delay.seconds if rpm_delay.corrected else 0.0),
        **_distances(
            log, vehicle, t, rotation, position,
            range_delay.seconds if range_delay is not None and range_delay.corrected else 0.0,
        ),
    )  # fmt: skip
    notes += _unseen(log, vehicle)
    state = corrected_state(effects, state)
    context = Context(state, vehicle, model)
    with_rpm = replace(state, rpm=context.rotor_rpm)
    servo_filled = replace(with_rpm, servo_us=np.where(np.isfinite(state.servo_us), state.servo_us, _neutral(vehicle)))
    modelled = modelled_wrench(vehicle, model, servo_filled)
    if effects:
        modelled = modelled + adopted_wrench(effects, context)
    measured = measured_wrench(force, gyro, _rate(gyro, grid.rate), vehicle.mass_kg, vehicle.inertia_kgm2)
    valid, excluded = _valid(log, context, grid, force, modelled, notes, axes)
    raw = np.where(valid[:, None], measured - modelled, np.nan)
    if 3 not in axes:
        raw[:, 3:] = 0.0
    residual = grid.smooth(raw)
    kinematic = _kinematic_bias(force, rotation, velocity, grid)
    small = _decimated(state, grid)
    keep = np.isfinite(residual).all(axis=1) & grid.pick(valid)
    channels = _channels(log, vehicle, small)
    record = Record(
        name=name or log.path.name,
        log=log,
        context=Context(small, vehicle, model),
        residual=residual,
        measured=grid.smooth(np.where(valid[:, None], measured, np.nan)),
        valid=keep,
        axes=tuple(axes),
        step_s=grid.every / grid.rate,
        kinematic_bias=grid.smooth(np.where(valid[:, None], kinematic, np.nan)),
        channels=channels,
        delays=tuple(delays),
        excluded=tuple(excluded),
        notes=tuple(notes),
    )
    if record.seconds < SHORTEST_S:
        worst = max(excluded, key=lambda e: e.seconds).reason if excluded else "gaps"
        raise LogError(
            f"{log.path}: only {record.seconds:.0f} s of flight can be judged (most time lost to: {worst}); "
            f"{SHORTEST_S:.0f} s are needed"
        )
    return record


def _imu(log: FlightLog) -> ImuRecord:
    if not log.imus:
        raise LogError(f"{log.path}: no HIGHRES_IMU, RAW_IMU or SCALED_IMU: a log without accelerometer tells no force")
    if log.attitude is None:
        raise LogError(f"{log.path}: no ATTITUDE or ATTITUDE_QUATERNION; stream one of them")
    return max(log.imus, key=lambda i: (i.specific_force.rate_hz >= FORCE_RATE_HZ, i is log.imus[0]))


def _overlap(a: Array, b: Array, k: int) -> float:
    return float(a[max(0, -k) : len(a) - max(0, k)] @ b[max(0, k) : len(b) - max(0, -k)])


def _unit(q: Array) -> Array:
    with np.errstate(invalid="ignore"):
        unit: Array = q / np.linalg.norm(q, axis=1, keepdims=True)
    return unit


def _rate(x: Array, rate_hz: float) -> Array:
    return np.gradient(x, 1.0 / rate_hz, axis=0)


def _column(series: Series | None, column: int, t: Array, gap_s: float = 3.0) -> Array:
    if series is None or column >= series.values.shape[1]:
        return np.full(len(t), np.nan)
    return series.at(t, gap_s)[:, column]


def _rotors(log: FlightLog, vehicle: Vehicle, t: Array, late_s: float) -> dict[str, Array]:
    rpm = np.full((len(t), len(vehicle.rotors)), np.nan)
    for k, rotor in enumerate(vehicle.rotors):
        esc = log.escs.get(rotor.esc) if rotor.esc is not None else None
        if esc is not None and esc.rpm is not None:
            rpm[:, k] = esc.rpm.at(t + late_s, MAX_GAP_S)[:, 0]
    servo = np.full((len(t), 16), np.nan)
    if log.servo is not None:
        late = late_s if not vehicle.telemetered else 0.0  # vanes share the clock of the outputs, not of the ESCs
        columns = min(16, log.servo.values.shape[1])
        servo[:, :columns] = log.servo.at(t + late, MAX_GAP_S)[:, :columns]
        servo[servo == 0.0] = np.nan
    return {"rpm": rpm, "servo_us": servo}


def _raw_state(
    log: FlightLog, vehicle: Vehicle, t: Array, force: Array, gyro: Array, rotation: Array, position: Array,
    velocity: Array,
) -> AirState:  # fmt: skip
    if vehicle.telemetered:
        lacking = [
            r.esc for r in vehicle.rotors if r.esc is None or r.esc not in log.escs or log.escs[r.esc].rpm is None
        ]
        if lacking:
            raise LogError(
                f"{log.path}: no rotor speed of ESC {', '.join(map(str, lacking))} (ESC_TELEMETRY, ESC_STATUS); "
                "log it, or declare [throttle] and servo outputs in the vehicle file"
            )
    elif log.servo is None:
        raise LogError(f"{log.path}: no SERVO_OUTPUT_RAW, and the vehicle file declares thrust by servo outputs")
    temperatures = [
        log.escs[r.esc].temperature_c.at(t, 5.0)[:, 0]  # type: ignore[union-attr]
        for r in vehicle.rotors
        if r.esc is not None and r.esc in log.escs and log.escs[r.esc].temperature_c is not None
    ]
    if not temperatures:
        temperatures = [e.temperature_c.at(t, 5.0)[:, 0] for e in log.escs.values() if e.temperature_c is not None]
    n, fans = len(t), len(vehicle.fans)
    return AirState(
        time_s=t,
        position_ned=position,
        velocity_ned=velocity,
        rotation=rotation,
        rates=gyro,
        specific_force=force,
        ranges_m=np.full((n, 6), np.inf),
        h_m=np.full((n, fans), np.inf),
        d_m=np.full((n, fans), np.inf),
        wall_bearing_rad=np.zeros(n),
        ceiling_m=np.full((n, fans), np.inf),
        thrust_command=_column(log.thrust_command, 0, t, 1.0),
        battery_voltage_v=_column(log.battery, 0, t, 10.0),
        battery_current_a=_column(log.battery, 1, t, 10.0),
        esc_temperature_c=np.mean(temperatures, axis=0) if temperatures else np.full(n, np.nan),
        pressure_pa=_column(log.pressure, 0, t, 10.0),
        air_temperature_c=_column(log.pressure, 1, t, 10.0),
        **_rotors(log, vehicle, t, 0.0),
    )


def _equal_outputs(log: FlightLog, vehicle: Vehicle) -> bool:
    if log.servo is None or len(vehicle.rotors) < 2:
        return False
    outputs = log.servo.values[:, [r.servo - 1 for r in vehicle.rotors if r.servo is not None]]
    return bool(np.nanmax(np.ptp(outputs, axis=1)) <= 1.0)


def _neutral(vehicle: Vehicle) -> Array:
    out = np.full(16, np.nan)
    for vane in vehicle.vanes:
        out[vane.servo - 1] = vane.neutral_us
    return out


# --- Delays -----------------------------------------------------------------------------------------------------------


def _rotor_delay(ctx: Context, grid: _Grid) -> Delay:
    """How late the rotor speeds (or outputs) are stamped, from lift against the accelerometer.

    A telemetry delay makes speeds late, the IMU's filter makes them early by a few hundredths of a second: both are
    taken out. Thrust that comes still later than the speed is physics (``motor_lag``) and stays.
    """
    lift = ctx.thrust.sum(axis=1)
    heave = -ctx.vehicle.mass_kg * ctx.state.specific_force[:, 2]
    best, correlation = _lag(heave, lift, grid.rate)
    corrected = bool(correlation > 0.3 and best > -FILTER_DELAY_S)
    return Delay("rotor speed" if ctx.vehicle.telemetered else "servo outputs", best, correlation, corrected)


def _range_delay(
    log: FlightLog, vehicle: Vehicle, t: Array, rotation: Array, velocity: Array, position: Array
) -> Delay | None:
    """How late the ground rangefinder is stamped, from its rate against the velocity."""
    cg = _ground_height(log, vehicle, t, rotation, 0.0)
    if cg is None or not np.isfinite(velocity[:, 2]).any():
        return None
    rate = 1.0 / float(t[1] - t[0])
    climb = np.gradient(_running_mean(cg, max(int(0.1 * rate), 1)), 1.0 / rate)
    climb = np.where(np.abs(climb) < 2.0, climb, np.nan)
    best, correlation = _lag(-velocity[:, 2], climb, rate)
    return Delay("ground range", best, correlation, bool(correlation > 0.5 and best > 0.0))


def _running_mean(x: Array, half: int) -> Array:
    kernel = np.ones(2 * half + 1)
    known = np.isfinite(x) & (np.abs(x) < 1e6)
    weight = np.convolve(known.astype(float), kernel, "same")
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(weight > 0, np.convolve(np.where(known, x, 0.0), kernel, "same") / weight, np.nan)


def _lag(reference: Array, signal: Array, rate: float) -> tuple[float, float]:
    """Lag [s] by which ``signal`` is behind ``reference`` (positive: late), and the correlation there."""
    width = max(int(0.7 * rate), 1)
    a, b = (_running_mean(x, max(int(0.03 * rate), 0)) - _running_mean(x, width) for x in (reference, signal))
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < 100:
        return 0.0, 0.0
    a, b = np.where(both, a, 0.0), np.where(both, b, 0.0)
    reach = max(int(LONGEST_DELAY_S * rate), 1)
    norm = float(np.sqrt((a @ a) * (b @ b)))
    if norm <= 0.0:
        return 0.0, 0.0
    lags = np.arange(-reach, reach + 1)
    scores = np.array([_overlap(a, b, int(k)) / norm for k in lags])
    i = int(scores.argmax())
    shift = 0.0
    if 0 < i < len(lags) - 1:
        left, mid, right = scores[i - 1 : i + 2]
        bend = left - 2 * mid + right
        shift = float(0.5 * (left - right) / bend) if bend < 0 else 0.0
    return float((lags[i] + shift) / rate), float(scores[i])


# --- Distances --------------------------------------------------------------------------------------------------------


def _beam_reading(beam: Beam, t: Array) -> Array:
    """Slant range (n,): inf where the sensor says that nothing is there, NaN where it tells nothing."""
    good = beam.good
    out = good.at(t, MAX_GAP_S)[:, 0] if len(good) > 1 else np.full(len(t), np.nan)
    told = beam.distance.t_s
    far = np.array([v is RangeVerdict.ABOVE_MAX for v in beam.verdicts])
    known = np.array([v in (RangeVerdict.OK, RangeVerdict.ABOVE_MAX) for v in beam.verdicts])
    if known.any():
        nearest = np.clip(np.searchsorted(told[known], t), 0, int(known.sum()) - 1)
        before = np.maximum(nearest - 1, 0)
        times = told[known]
        pick = np.where(np.abs(times[before] - t) < np.abs(times[nearest] - t), before, nearest)
        close = np.abs(times[pick] - t) <= MAX_GAP_S
        out = np.where(close & far[known][pick], np.inf, out)
    return out


def _beam_of(log: FlightLog, orientation: int) -> Beam | None:
    wanted = orientation_direction(orientation)
    if wanted is None:
        return None
    from replay.flightlog import best_beam, direction_name

    return best_beam([b for b in log.beams if b.name == direction_name(wanted) and b.name != "other"])


def _ground_height(log: FlightLog, vehicle: Vehicle, t: Array, rotation: Array, late_s: float) -> Array | None:
    """Height of the CG over the ground (n,), or None without a ground rangefinder."""
    for sensor in vehicle.rangefinders_for("ground"):
        beam = _beam_of(log, sensor.orientation)
        if beam is None or not len(beam.good):
            continue
        slant = _beam_reading(beam, t + late_s)
        direction = np.asarray(beam.direction_frd)
        cosine = rotation[:, 2] @ direction
        with np.errstate(invalid="ignore"):
            height = rotation[:, 2] @ np.asarray(sensor.position_m) + slant * cosine
        return np.where(cosine > MAX_INCIDENCE_COS, height, np.nan)
    return None


def _unseen(log: FlightLog, vehicle: Vehicle) -> list[str]:
    """A line for everything that a declared rangefinder looks at and no message of the log measures."""
    notes = []
    for target in ("ground", "wall", "ceiling"):
        sensors = vehicle.rangefinders_for(target)
        beams = [_beam_of(log, sensor.orientation) for sensor in sensors]
        if sensors and not any(beam is not None and len(beam.good) for beam in beams):
            notes.append(f"no range to the {target} in the log, but a declared rangefinder: taken to be far away")
    return notes


def _distances(
    log: FlightLog, vehicle: Vehicle, t: Array, rotation: Array, position: Array, late_s: float
) -> dict[str, Array]:
    n, fans = len(t), len(vehicle.fans)
    h, d = np.full((n, fans), np.inf), np.full((n, fans), np.inf)
    ceiling, bearing = np.full((n, fans), np.inf), np.zeros(n)
    ranges = np.full((n, 6), np.nan)
    for i, direction in enumerate(DIRECTIONS):
        beam = log.beam(direction)
        if beam is not None:
            ranges[:, i] = _beam_reading(beam, t + late_s)
    arms = [np.asarray(f.position_m) for f in vehicle.fans]
    height = _ground_height(log, vehicle, t, rotation, late_s)
    if height is not None:
        h = np.stack([np.maximum(height - rotation[:, 2] @ arm, 0.0) for arm in arms], axis=1)
    for sensor in vehicle.rangefinders_for("wall"):
        beam = _beam_of(log, sensor.orientation)
        if beam is None or not len(beam.good):
            continue
        axis, mount = np.asarray(beam.direction_frd), np.asarray(sensor.position_m)
        slant = _beam_reading(beam, t + late_s)
        world = rotation @ axis
        level = np.hypot(world[:, 0], world[:, 1])
        normal = np.where(level[:, None] > 0, world * [1, 1, 0] / np.maximum(level, 1e-9)[:, None], 0.0)
        toward = np.einsum("ni,nij->nj", normal, rotation)
        with np.errstate(invalid="ignore"):
            distance = toward @ mount + slant * level
            drop = rotation[:, 2] @ mount + slant * world[:, 2]
            floor = height if height is not None else np.full(n, np.inf)
            seen = (level > MAX_INCIDENCE_COS) & np.isfinite(slant) & ~(drop > floor - 0.05)
        own = np.stack([distance - toward @ f - fan.lip_radius_m for f, fan in zip(arms, vehicle.fans, strict=True)], 1)
        d = np.where(seen[:, None], np.maximum(own, 0.0), np.where(np.isnan(slant)[:, None], np.nan, np.inf))
        bearing = np.where(seen, np.arctan2(toward[:, 1], toward[:, 0]), 0.0)
        break  # the first declared wall rangefinder is the model's wall; others are second walls
    up = None
    for sensor in vehicle.rangefinders_for("ceiling"):
        up = _beam_of(log, sensor.orientation)
        mount = np.asarray(sensor.position_m)
    if up is None and not vehicle.rangefinders_for("ceiling"):
        up, mount = log.beam("up"), np.zeros(3)
    if up is not None and len(up.good):
        slant = _beam_reading(up, t + late_s)
        cosine = -(rotation[:, 2] @ np.asarray(up.direction_frd))
        with np.errstate(invalid="ignore"):
            over = slant * cosine - rotation[:, 2] @ mount
            over = np.where(cosine > MAX_INCIDENCE_COS, over, np.inf)
        over = np.where(np.isnan(over), np.inf, over)
        ceiling = np.stack([over + rotation[:, 2] @ arm for arm in arms], axis=1)
    return {"h_m": h, "d_m": d, "ceiling_m": ceiling, "wall_bearing_rad": bearing, "ranges_m": ranges}


# --- What to leave out ------------------------------------------------------------------------------------------------


def _valid(
    log: FlightLog, ctx: Context, grid: _Grid, force: Array, modelled: Array, notes: list[str], axes: list[int]
) -> tuple[Mask, list[Excluded]]:
    state, rate, t = ctx.state, grid.rate, grid.t
    valid = np.ones(len(t), bool)
    excluded: list[Excluded] = []

    def leave_out(reason: str, bad: Any, around_s: float = 0.0) -> None:
        if around_s > 0.0 and bad.any():
            bad = np.convolve(bad, np.ones(2 * int(around_s * rate) + 1), "same") > 0.5
        new = valid & bad
        if new.sum() / rate >= 0.05:
            excluded.append(Excluded(reason, float(new.sum() / rate)))
        valid[bad] = False

    leave_out("no IMU, attitude or rotor speed (gap in the log)", ~np.isfinite(force).all(axis=1)
              | ~np.isfinite(state.rotation).all(axis=(1, 2)) | ~np.isfinite(ctx.thrust).all(axis=1))  # fmt: skip
    with np.errstate(invalid="ignore"):
        lift = ctx.thrust.sum(axis=1)
        flying = _running_mean(lift, int(0.2 * rate)) > AIRBORNE_SHARE * ctx.weight
    for interval in log.landed:
        if interval.value == 1:
            flying &= ~((t >= interval.start_s) & (t < interval.end_s))
    if log.armed:
        armed = np.zeros(len(t), bool)
        for interval in log.armed:
            armed |= (t >= interval.start_s - 1.0) & (t <= interval.end_s + 1.0)
        flying &= armed
    leave_out("on the ground, or taking off or landing", ~flying, 1.0)
    touching = np.nanmin(np.where(np.isfinite(state.h_m), state.h_m, np.inf), axis=1) < 0.1 * ctx.vehicle.rotor_radius_m
    leave_out("at the ground (closer than a tenth of a rotor radius)", touching, 0.3)
    leave_out("no height over ground", np.isnan(state.h_m).any(axis=1))
    leave_out("no distance to the wall", np.isnan(state.d_m).any(axis=1))
    finite_h = np.where(np.isfinite(state.h_m[:, 0]), state.h_m[:, 0], np.nan)
    if np.isfinite(finite_h).any() and np.isfinite(state.velocity_ned[:, 2]).any():
        with np.errstate(invalid="ignore"):
            jump = np.abs(_rate(finite_h[:, None], rate)[:, 0] + state.velocity_ned[:, 2]) > 2.5
        leave_out("the ground under the rangefinder jumped", jump, 0.2)
    for axis in range(3):
        size = np.abs(force[:, axis])
        top = np.nanmax(size) if np.isfinite(size).any() else 0.0
        clipped = size >= top * (1.0 - 1e-6)
        if clipped.sum() >= max(20, 0.004 * len(size)) and top > 0.5:
            share = float(np.mean(clipped))
            notes.append(f"accelerometer {'xyz'[axis]} clipped at {top:.1f} m/s^2 in {share:.0%} of the samples")
            if share > 0.02 and axis in axes:
                axes.remove(axis)
                notes.append(f"F{'xyz'[axis]} is not judged: its mean is not to be trusted")
            else:
                leave_out("the accelerometer was clipped", clipped, 0.3)
    leave_out("the model has no answer", ~np.isfinite(modelled[:, :3]).all(axis=1))
    return valid, excluded


def _kinematic_bias(force: Array, rotation: Array, velocity: Array, grid: _Grid) -> Array:
    if not np.isfinite(velocity).any():
        return np.full_like(force, np.nan)
    accel = _rate(velocity, grid.rate)
    accel[:, 2] -= GRAVITY
    out: Array = force - np.einsum("nji,nj->ni", rotation, accel)
    return out


def _decimated(state: AirState, grid: _Grid) -> AirState:
    """The state at the record's rate: smooth quantities smoothed, distances with their infinities kept."""

    def careful(x: Array) -> Array:
        smooth = grid.smooth(np.where(np.isfinite(x), x, np.nan))
        picked = grid.pick(x)
        return np.where(np.isfinite(picked) & np.isfinite(smooth), smooth, picked)

    rotation = grid.smooth(state.rotation)
    return AirState(
        time_s=grid.pick(state.time_s),
        position_ned=grid.smooth(state.position_ned),
        velocity_ned=grid.smooth(state.velocity_ned),
        rotation=rotation,
        rates=grid.smooth(state.rates),
        specific_force=grid.smooth(state.specific_force),
        ranges_m=careful(state.ranges_m),
        h_m=careful(state.h_m),
        d_m=careful(state.d_m),
        wall_bearing_rad=grid.pick(state.wall_bearing_rad),
        ceiling_m=careful(state.ceiling_m),
        rpm=grid.smooth(state.rpm),
        servo_us=grid.smooth(state.servo_us),
        thrust_command=grid.smooth(state.thrust_command),
        battery_voltage_v=grid.smooth(state.battery_voltage_v),
        battery_current_a=grid.smooth(state.battery_current_a),
        esc_temperature_c=grid.smooth(state.esc_temperature_c),
        pressure_pa=grid.smooth(state.pressure_pa),
        air_temperature_c=grid.smooth(state.air_temperature_c),
    )


def _channels(log: FlightLog, vehicle: Vehicle, state: AirState) -> dict[str, Array]:
    """What the flexible search may look at, by the contract's names."""
    r = state.rotation
    with np.errstate(invalid="ignore"):
        out = {
            "time_s": state.time_s,
            "roll_rad": np.arctan2(r[:, 2, 1], r[:, 2, 2]),
            "pitch_rad": -np.arcsin(np.clip(r[:, 2, 0], -1.0, 1.0)),
            "yaw_rad": np.arctan2(r[:, 1, 0], r[:, 0, 0]),
        }
    for names, values in (
        (("north_m", "east_m", "down_m"), state.position_ned),
        (("vn_m_s", "ve_m_s", "vd_m_s"), state.velocity_ned),
        (("p_rad_s", "q_rad_s", "r_rad_s"), state.rates),
        (("ax_m_s2", "ay_m_s2", "az_m_s2"), state.specific_force),
    ):
        out |= {name: values[:, i] for i, name in enumerate(names)}
    out |= {f"range_{name}_m": state.ranges_m[:, i] for i, name in enumerate(DIRECTIONS)}
    out |= {
        f"rpm_{k + 1 if rotor.esc is None else rotor.esc}": state.rpm[:, k] for k, rotor in enumerate(vehicle.rotors)
    }
    out |= {f"servo_{k + 1}": state.servo_us[:, k] for k in range(16)}
    out |= {
        "thrust_command": state.thrust_command,
        "battery_voltage_v": state.battery_voltage_v,
        "battery_current_a": state.battery_current_a,
        "esc_temperature_c": state.esc_temperature_c,
        "pressure_pa": state.pressure_pa,
        "air_temperature_c": state.air_temperature_c,
    }
    return {name: values for name, values in out.items() if np.isfinite(values).mean() > 0.3}


def check_model(vehicle: Vehicle, model: FanSurrogate | None) -> None:
    """ConfigError where the empty model is asked of a vehicle file without ``ct``."""
    if model is None and vehicle.telemetered and any(f.ct is None for f in vehicle.fans):
        raise ConfigError("vehicle file: key 'fan.ct' is missing, and --model none has no free-air rows to replace it")
