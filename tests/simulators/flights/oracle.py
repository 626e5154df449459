"""What a residual shows before and after the true effect is removed: the yardstick for every diagnosis.

The residual is formed from the recorded sensor signals (delays undone), with the declared vehicle and the declared law
itself in place of a surrogate. Removing ``Tape.effect`` leaves sensor errors and unsteady air: the oracle.
"""

from __future__ import annotations

import numpy as np

from . import near_wall
from .craft import VANE_NEUTRAL, VANE_RAD_PER_US, Array, Craft, Ranger
from .recorder import TICK_S, Sensed
from .world import rpm_of_output

BANDWIDTHS_HZ = (1.0, 2.0, 5.0, 12.0)


def residual(
    craft: Craft,
    seen: Sensed,
    sensors: tuple[Ranger, ...],
    *,
    by_servo: bool,
    mass_factor: float = 1.0,
) -> Array:
    """Measured minus declared wrench about the declared CG, body FRD, (t, 6)."""
    w, x, y, z = seen.quaternion.T
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    fans = np.einsum("jkt,kf->jft", rotation, np.array(craft.fan_position).T)
    beams = {s.orientation: seen.ranges[:, i] for i, s in enumerate(sensors)}
    h = (_fill(beams[25]) + craft.down_ranger_m) * rotation[2, 2] - fans[2]
    right = _fill(beams[2])
    beside = np.where(rotation[1, 1] > 0.3, (right + craft.side_ranger_m) * rotation[1, 1], np.inf)
    d = beside - fans[1] - craft.lip_m
    count = len(craft.fan_position)
    pwm = seen.pwm.T
    if by_servo:
        rpm = rpm_of_output(craft, pwm[:count])
    else:
        rpm = seen.rpm.T.reshape(count, craft.rotors_per_fan, -1).mean(axis=1)
    bearing = np.pi / 2 - np.arctan2(rotation[1, 0], rotation[0, 0])
    wrench = near_wall.to_body(near_wall.fan_wrench(craft, h, d, rpm), bearing)
    force, moment = wrench[:3].sum(axis=1), wrench[3:].sum(axis=1)
    for f, arm in enumerate(craft.fan_position):
        moment += np.cross(np.array(arm), wrench[:3, f].T).T
    if craft.cq:
        torque = craft.cq / craft.ct * craft.radius_m * near_wall.free_thrust(craft, rpm)
        moment[2] -= (np.array(craft.spin)[:, None] * torque).sum(axis=0)
    for f, (px, _, pz) in enumerate(craft.vane_position):
        side = craft.vane_gain * VANE_RAD_PER_US * (pwm[count + f] - VANE_NEUTRAL) * -wrench[2, f]
        force[1] += side
        moment[0] -= pz * side
        moment[2] += px * side
    inertia = np.array(craft.inertia)
    turning = np.gradient(seen.gyro, TICK_S, axis=0)
    measured_m = inertia * turning + np.cross(seen.gyro, inertia * seen.gyro)
    measured_f = craft.mass_kg * mass_factor * seen.accel
    return np.hstack([measured_f - force.T, measured_m - moment.T])


def _fill(beam: Array) -> Array:
    """Hold readings between samples (linear), inf where nothing is hit, bad readings ignored."""
    out = np.full(len(beam), np.inf)
    far = np.isinf(beam)
    good = ~np.isnan(beam) & (beam > 0.0) & ~far
    if good.any():
        index = np.arange(len(beam))
        out = np.interp(index, index[good], beam[good])
        known = ~np.isnan(beam) & (beam > 0.0)
        last = np.maximum.accumulate(np.where(known, index, 0))
        out[far[last]] = np.inf
    return out


def low_pass(x: Array, hz: float) -> Array:
    """Zero-phase second-order Butterworth, twice."""
    from scipy.signal import butter, sosfiltfilt

    out: Array = sosfiltfilt(butter(2, hz, fs=1.0 / TICK_S, output="sos"), x, axis=0)
    return out


def rms_table(before: Array, effect: Array) -> dict[str, dict[str, list[float]]]:
    """RMS per axis before and after removing the effect, by bandwidth."""
    table = {}
    for hz in BANDWIDTHS_HZ:
        raw, rest = low_pass(before, hz), low_pass(before - effect, hz)
        table[f"{hz:g}"] = {
            "axes": ["Fx", "Fy", "Fz", "Mx", "My", "Mz"],
            "before": np.sqrt((raw**2).mean(axis=0)).round(4).tolist(),
            "oracle": np.sqrt((rest**2).mean(axis=0)).round(4).tolist(),
        }
    return table
