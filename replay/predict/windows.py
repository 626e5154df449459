"""Windows of a flight from which its motion is foretold: what was measured at their start, and what followed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.air_state import AirState
from models.common.errors import LogError
from models.common.frames import Array, rotation_from_quaternion
from models.vehicle import Vehicle
from replay.predict.rollout import POSITION, QUATERNION, RATES, STATE, VELOCITY, Surroundings
from replay.residual.grid import Mask
from replay.residual.record import Flown

STRIDE_S = 0.1
"""From the start of one window to that of the next, at least."""
MOST = 1000
"""Windows of a flight; of a longer one they lie farther apart."""


@dataclass(frozen=True, kw_only=True)
class Windows:
    """``n`` windows of ``steps`` steps each, of one flight."""

    at_s: Array
    """(n,) when they start, in the time of the log."""
    states: Array
    """(n, 13) at their start, as ``rollout`` takes them."""
    inputs: Array
    """(n, steps, rotors) rotor speeds [rpm], or outputs [us]."""
    measured: Array
    """(n, steps, 13) what followed."""
    rotations: Array
    """(n, steps, 3, 3) measured attitude in the middle of every step."""
    rows: NDArray[np.int64]
    """(n, steps) rows of the flight at the start of every step."""
    near: Surroundings
    weather: AirState
    step_s: float
    left_out: int
    """Windows with a gap, or in time that is not judged."""
    placed: bool
    """Whether the place was measured."""


def windows(flown: Flown, horizon_s: float, after_s: float) -> Windows:
    """All windows of a flight that begin at ``after_s`` or later. Raises LogError where there is none."""
    state = flown.context.state
    vehicle = flown.context.vehicle
    step_s = 1.0 / flown.motion.grid.rate
    steps = max(round(horizon_s / step_s), 1)
    inputs = rotor_inputs(vehicle, state)
    full, placed = _states(flown)
    known = flown.time.valid & np.isfinite(full).all(axis=1) & np.isfinite(inputs).all(axis=1)
    distances = np.concatenate([state.h_m, state.d_m], axis=1)
    known &= ~np.isnan(distances).any(axis=1)
    starts = _starts(state.time_s, step_s, steps, after_s)
    whole = _all_known(known, starts, steps)
    chosen = starts[whole]
    if not len(chosen):
        raise LogError(
            f"{flown.log.path}: no window of {horizon_s:g} s without a gap to foretell; a shorter "
            "--horizon may help"
        )
    rows = chosen[:, None] + np.arange(steps)
    return Windows(
        at_s=state.time_s[chosen],
        states=full[chosen],
        inputs=inputs[rows],
        measured=full[rows + 1],
        rotations=halfway(full[rows, QUATERNION], full[rows + 1, QUATERNION]),
        rows=rows,
        near=Surroundings(
            h_m=state.h_m[chosen],
            d_m=state.d_m[chosen],
            wall_bearing_rad=state.wall_bearing_rad[chosen],
        ),
        weather=state.take(chosen),
        step_s=step_s,
        left_out=int((~whole).sum()),
        placed=placed,
    )


def rotor_inputs(vehicle: Vehicle, state: AirState) -> Array:
    """What drives the rotors (n, rotors): their speeds [rpm], or outputs [us] where these declare the thrust."""
    if vehicle.telemetered:
        return state.rpm
    channels = [rotor.servo - 1 for rotor in vehicle.rotors if rotor.servo is not None]
    return np.asarray(state.servo_us[:, channels])


def _states(flown: Flown) -> tuple[Array, bool]:
    """The flight as states (n, 13), and whether its place is known; an unknown place is the origin."""
    state = flown.context.state
    out = np.empty((len(state.time_s), STATE))
    placed = bool(np.isfinite(state.position_ned).any())
    out[:, POSITION] = state.position_ned if placed else 0.0
    out[:, VELOCITY] = state.velocity_ned
    out[:, QUATERNION] = quaternions(state.rotation)
    out[:, RATES] = state.rates
    return out, placed


def quaternions(rotations: Array) -> Array:
    """Unit quaternions (n, 4), w first, of rotation matrices (n, 3, 3); NaN where those are."""
    from scipy.spatial.transform import Rotation

    out = np.full((len(rotations), 4), np.nan)
    known = np.isfinite(rotations).all(axis=(1, 2))
    if known.any():
        x_first = Rotation.from_matrix(rotations[known]).as_quat()
        out[known] = np.roll(x_first, 1, axis=1)
    return out


def halfway(first: Array, second: Array) -> Array:
    """Rotation matrices (..., 3, 3) half way from the unit quaternions (..., 4) of one instant to those of the next.

    The sum of two unit quaternions of one sign lies on the great arc between them, at its middle (Shoemake 1985,
    SIGGRAPH Computer Graphics 19, 245).
    """
    same = (first * second).sum(axis=-1, keepdims=True) >= 0.0
    total = first + np.where(same, second, -second)
    return rotation_from_quaternion(total / np.linalg.norm(total, axis=-1, keepdims=True))


def _starts(time_s: Array, step_s: float, steps: int, after_s: float) -> NDArray[np.int64]:
    """Rows (k,) at which windows begin."""
    last = len(time_s) - steps - 1
    first = int(np.searchsorted(time_s, after_s))
    stride = max(round(STRIDE_S / step_s), 1, -(-(last - first) // MOST))
    return np.arange(first, max(last, first), stride)


def _all_known(known: Mask, starts: NDArray[np.int64], steps: int) -> Mask:
    """(k,) whether all rows of a window, and the one after its last step, are known."""
    count = np.concatenate([[0], np.cumsum(known)])
    return np.asarray(count[starts + steps + 1] - count[starts] == steps + 1)
