"""What the hold steers: how late positions are, how the attitude answers, and the gains and margin that follow.

The attitude loop is taken as second order with a dead time: two equal lags tau and a delay T, from the autopilot's
parameters until its answer to our own setpoints has been measured. The margins are those of the open loop at the
acceleration command (Astrom and Murray, Feedback Systems, 2nd ed. 2021, chapter 10), computed over frequency.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.control.dead_reckoning import KEPT_S
from companion.estimation.estimates import ATTITUDE_AGE_S, POSITION_AGE_S
from companion.mavlink.firmware import Stack
from models.common.frozen_copy import with_changes

Frequencies = NDArray[np.complexfloating[Any, Any]]
"""A complex quantity over frequency, shape (n,)."""


@dataclass(frozen=True)
class Margin:
    """Room before the hold's loop swings by itself."""

    gain: float
    """The loop's gain may rise by this factor; 1 is the limit of stability."""
    phase_deg: float

    def meets(self, least: Margin) -> bool:
        """Whether both are at least those of ``least``."""
        return self.gain >= least.gain and self.phase_deg >= least.phase_deg

    def share_of(self, wanted: Margin) -> float:
        """The smaller of the two shares of what is wanted."""
        return min(self.gain / wanted.gain, self.phase_deg / wanted.phase_deg)


@dataclass(frozen=True, kw_only=True)
class HoldGains:
    """The position hold: horizontal and vertical loops about a reference. SI."""

    position_1_s: float = 2.2
    """Horizontal speed asked for per metre of error."""
    velocity_1_s: float = 5.0
    """Horizontal acceleration per m/s of error: the damping that bounds what may be fed forward near a wall."""
    integral_1_s2: float = 2.0
    height_1_s: float = 3.3
    climb_1_s: float = 7.0
    climb_integral_1_s2: float = 4.0
    tilt_lead_s: float = 0.144
    """How far ahead velocity is predicted from the tilt that there is."""
    lag_s: float = 0.24
    """How late the attitude loop answers: the reference waits for it."""


FULL = HoldGains()
"""As hard as a quick vehicle takes them."""

_ARDUPILOT_INPUT_TC_S = 0.15
"""Default of ATC_INPUT_TC."""
_PX4_ANGLE_P = 6.5
"""Default of MC_ROLL_P and MC_PITCH_P."""
_ARDUPILOT_DELAY_S = 0.09
_PX4_DELAY_S = 0.10
"""Dead time of link, scheduling and rate loop: fitted to recordings of ArduCopter 4.6.3 (ATC_INPUT_TC 0.15 and 0.3) and
PX4 1.16 in simulation, which the two laws of ``declared_loop`` meet within 0.03 s of total lag."""
_PX4_LAG_SHARE = 1.0 / 3.0
"""tau over 1/P: the two lags make up two thirds of the angle loop's time, the delay has the rest."""
_THRUST_DELAY_S = 0.03
_THRUST_LAG_S = 0.06
"""Link and mixer, then motors: ArduCopter 4.6.3 echoes a thrust command after 12 ms, motors take 0.05 to 0.08 s."""
_NOMINAL_PERIOD_S = 0.02
"""Attitudes at 50 Hz, as asked for; the delays above hold for that."""
_OMEGA = np.geomspace(0.2, 40.0, 500)
"""rad/s: from well below the integrators to well above any crossover."""
_J_OMEGA = 1j * _OMEGA
TILT_MEAN_S = 0.8
"""A tilt that lasts longer than this balances something and accelerates nothing. At half of it the phase margin is 5
degrees lower, at twice of it a slow disturbance is answered later (docs/lab/hold.md)."""
CLIMB_LEAD_S = 0.05
"""How far ahead vertical velocity is predicted from the acceleration that was asked for: about what motors are late."""
_TILT_LEAD_SHARE = 0.6
"""How far ahead velocity is predicted from the tilt that there is: a share of the loop's own lag."""
_WANTED = Margin(gain=1.7, phase_deg=22.0)
"""Level gains have at least this. Textbooks ask for 2 and 30 degrees (Astrom and Murray 2021, 10.3): those gains are
drawn further to a wall (docs/lab/hold.md)."""
_WANTED_CLIMB = Margin(gain=1.6, phase_deg=18.0)
"""The same of height."""
_SHARES = tuple(0.92**k for k in range(21))
"""Of height's gains, tried in this order: down to 0.19."""
_LEVEL_SHARES = _SHARES[::2]
"""Of the gains of position and velocity: in pairs, so in wider steps."""


class Source(Enum):
    """Where the attitude loop's numbers are from."""

    ASSUMED = "assumed"
    PARAMETERS = "parameters"
    MEASURED = "measured"


@dataclass(frozen=True)
class AttitudeLoop:
    """Tilt over commanded tilt: exp(-s delay) gain / (1 + s tau)^2."""

    tau_s: float = 0.5 * _ARDUPILOT_INPUT_TC_S
    delay_s: float = _PX4_DELAY_S
    gain: float = 1.0
    source: Source = Source.ASSUMED

    @property
    def lag_s(self) -> float:
        """How late a slow change is answered."""
        return 2.0 * self.tau_s + self.delay_s

    def response(self, s: Frequencies) -> Frequencies:
        """Complex gain at ``s`` = j omega."""
        out: Frequencies = self.gain * np.exp(-s * self.delay_s) / (1.0 + s * self.tau_s) ** 2
        return out


def declared_loop(stack: Stack, parameters: Mapping[str, float]) -> AttitudeLoop:
    """The attitude loop as the autopilot's parameters have it.

    ArduPilot shapes the target with ATC_INPUT_TC and feeds its rate forward, so that ATC_ANG_*_P hardly counts (2.25
    and 4.5 answer alike in flight); without ATC_RATE_FF_ENAB it does. PX4 has no shaping: MC_ROLL_P, MC_PITCH_P.
    """
    if stack is Stack.ARDUPILOT:
        known = "ATC_INPUT_TC" in parameters
        tau = 0.5 * max(parameters.get("ATC_INPUT_TC", _ARDUPILOT_INPUT_TC_S), 0.05)
        angle = min(parameters.get("ATC_ANG_RLL_P", 4.5), parameters.get("ATC_ANG_PIT_P", 4.5))
        if parameters.get("ATC_RATE_FF_ENAB", 1.0) == 0.0:
            tau += 0.5 / max(angle, 1.0)
        return AttitudeLoop(
            tau, _ARDUPILOT_DELAY_S, source=Source.PARAMETERS if known else Source.ASSUMED
        )
    if stack is Stack.PX4:
        named = [parameters[name] for name in ("MC_ROLL_P", "MC_PITCH_P") if name in parameters]
        angle = max(min(named, default=_PX4_ANGLE_P), 1.0)
        return AttitudeLoop(
            _PX4_LAG_SHARE / angle,
            _PX4_DELAY_S,
            source=Source.PARAMETERS if named else Source.ASSUMED,
        )
    return AttitudeLoop()


class Timing(NamedTuple):
    """Rates and lateness as they arrive: averages that rise at once and sink slowly."""

    position_period_s: float = _NOMINAL_PERIOD_S
    position_late_s: float = 0.0
    attitude_period_s: float = _NOMINAL_PERIOD_S
    position_s: float = -math.inf
    attitude_s: float = -math.inf


def _risen(old: float, new: float) -> float:
    """Half way up at once, a fortieth of the way down."""
    return old + (new - old) * (0.5 if new > old else 0.025)


def hear_position(timing: Timing, t_s: float, late_s: float) -> Timing:
    """Take in a position stamped ``t_s`` that arrives ``late_s`` later; a gap is no period."""
    period = timing.position_period_s
    gap_s = t_s - timing.position_s
    if 0.0 < gap_s <= POSITION_AGE_S:
        period = _risen(period, gap_s)
    late = _risen(timing.position_late_s, min(max(late_s, 0.0), POSITION_AGE_S))
    return timing._replace(position_period_s=period, position_late_s=late, position_s=t_s)


def hear_attitude(timing: Timing, t_s: float) -> Timing:
    """Take in an attitude stamped ``t_s``."""
    period = timing.attitude_period_s
    gap_s = t_s - timing.attitude_s
    if 0.0 < gap_s <= ATTITUDE_AGE_S:
        period = _risen(period, gap_s)
    return timing._replace(attitude_period_s=period, attitude_s=t_s)


@dataclass(frozen=True, kw_only=True)
class HoldTuning:
    """Gains chosen for a plant, and the margin that they have."""

    gains: HoldGains
    margin: Margin
    """The smaller of the horizontal and the vertical loop's, each figure by itself."""
    share: float
    """Of the full horizontal bandwidth: the root of the share of the full stiffness (position times velocity gain)."""
    climb_share: float
    loop: AttitudeLoop
    age_s: float = 0.0
    """Of a position when it is used."""
    least_wall_m: float = 0.0
    """Nearer to the wall that is seen, no gains hold against its pull."""


def margin_of(response: Frequencies) -> Margin:
    """Gain and phase margin of an open loop (n,) over ``_OMEGA``; gain below 1 or a negative phase is unstable.

    The loop has two integrators and an integral: below the crossover its phase may pass -180 degrees upward, and a
    gain too low is then as unstable as one too high. The smaller of the two distances is the gain margin.
    """
    size = np.abs(response)
    phase = np.degrees(np.unwrap(np.angle(response)))
    phase -= 360.0 * np.ceil(
        phase[0] / 360.0
    )  # an integral of an integral of a tilt starts between -360 and 0
    crossings = np.flatnonzero((size[:-1] >= 1.0) & (size[1:] < 1.0))
    if not len(crossings):
        return Margin(0.0, -180.0)
    last = int(crossings[-1])
    phase_margin = 180.0 + float(phase[crossings].min())
    down = np.flatnonzero((phase[:-1] >= -180.0) & (phase[1:] < -180.0))
    up = np.flatnonzero((phase[:-1] < -180.0) & (phase[1:] >= -180.0))
    if phase_margin <= 0.0:
        return Margin(float(min(1.0 / size[down], default=0.0)), phase_margin)
    distances = [*(1.0 / size[down[down >= last]]), *size[up[up <= last]]]
    return Margin(float(min(distances, default=np.inf)), phase_margin)


def horizontal_loop(
    gains: HoldGains,
    loop: AttitudeLoop,
    age_s: float,
    s: Frequencies = _J_OMEGA,
    stiffness_1_s2: float = 0.0,
) -> Frequencies:
    """Open loop (n,) over ``s`` from acceleration command to acceleration command.

    ``age_s``: how old a position is on average when it is used; it is carried on over that time by the tilts since.
    ``stiffness_1_s2``: k of a wall's pull that grows by k x towards it; the plant is 1 / (s^2 - k).
    """
    high_pass = s * TILT_MEAN_S / (1.0 + s * TILT_MEAN_S)
    late = np.exp(-s * age_s) / (1.0 - stiffness_1_s2 / s**2)
    carried_s = min(age_s, KEPT_S)
    gained = _gained(s, carried_s)
    velocity = late / s + gained.velocity * high_pass
    position = late / s**2 + carried_s * late / s + gained.place * high_pass
    slip = gains.position_1_s * position + velocity + gains.tilt_lead_s * high_pass
    out: Frequencies = loop.response(s) * (gains.velocity_1_s + gains.integral_1_s2 / s) * slip
    return out


class _Gained(NamedTuple):
    """What an acceleration has added to velocity and place within an age, over frequency."""

    velocity: Frequencies
    place: Frequencies


def _gained(s: Frequencies, age_s: float) -> _Gained:
    """v(t) - v(t - age) and x(t) - x(t - age) - age v(t - age) over a(t)."""
    delayed = np.exp(-s * age_s)
    return _Gained(
        velocity=(1.0 - delayed) / s,
        place=(1.0 - delayed) / s**2 - age_s * delayed / s,
    )


def vertical_loop(gains: HoldGains, age_s: float) -> Frequencies:
    """The same for height: the lift follows the command with a lag and a short dead time."""
    s = 1j * _OMEGA
    high_pass = s * TILT_MEAN_S / (1.0 + s * TILT_MEAN_S)
    plant = np.exp(-s * _THRUST_DELAY_S) / (1.0 + s * _THRUST_LAG_S)
    late = np.exp(-s * age_s)
    # What is predicted is what was asked for, before lag and delay.
    carried_s = min(age_s, KEPT_S)
    gained = _gained(s, carried_s)
    velocity = plant * late / s + (gained.velocity + CLIMB_LEAD_S) * high_pass
    position = plant * (late / s**2 + carried_s * late / s) + gained.place * high_pass
    out: Frequencies = (gains.climb_1_s + gains.climb_integral_1_s2 / s) * (
        gains.height_1_s * position + velocity
    )
    return out


def soften(
    gains: HoldGains,
    *,
    position_share: float = 1.0,
    velocity_share: float = 1.0,
    climb_share: float = 1.0,
) -> HoldGains:
    """Gains of which the position's, the velocity's and both of height are taken by a share.

    An integral is taken by the shares of both gains of its axis.
    """
    return HoldGains(
        position_1_s=gains.position_1_s * position_share,
        velocity_1_s=gains.velocity_1_s * velocity_share,
        integral_1_s2=gains.integral_1_s2 * position_share * velocity_share,
        height_1_s=gains.height_1_s * climb_share,
        climb_1_s=gains.climb_1_s * climb_share,
        climb_integral_1_s2=gains.climb_integral_1_s2 * climb_share**2,
        tilt_lead_s=gains.tilt_lead_s,
        lag_s=gains.lag_s,
    )


def tune(loop: AttitudeLoop, timing: Timing, softer: float = 1.0) -> HoldTuning:
    """The stiffest gains, at most ``FULL`` times ``softer``, that have the margin wanted.

    Where none has, the ones with the largest margin: whoever flies decides whether that is enough.
    """
    step = 0.005
    # A setpoint is held for a period, and the tilt that it was computed from may be a period old.
    extra = max(timing.attitude_period_s - _NOMINAL_PERIOD_S, 0.0)
    rounded = AttitudeLoop(
        round(loop.tau_s, 3),
        round(round((loop.delay_s + extra) / step) * step, 4),
        round(loop.gain, 2),
        loop.source,
    )
    age = round(round((timing.position_late_s + 0.5 * timing.position_period_s) / step) * step, 4)
    return _tuned(rounded, age, softer)


@lru_cache(maxsize=256)
def _tuned(loop: AttitudeLoop, age_s: float, softer: float) -> HoldTuning:
    hardest = with_changes(
        soften(FULL, position_share=softer, velocity_share=softer, climb_share=softer),
        tilt_lead_s=_TILT_LEAD_SHARE * loop.lag_s,
        lag_s=loop.lag_s,
    )
    level = _stiffest(hardest, loop, age_s)
    climb_share, vertical = _hardest_climb(hardest, age_s)
    gains = soften(level.gains, climb_share=climb_share)
    margin = Margin(
        gain=min(level.margin.gain, vertical.gain),
        phase_deg=min(level.margin.phase_deg, vertical.phase_deg),
    )
    stiffness_share = (gains.position_1_s / FULL.position_1_s) * (
        gains.velocity_1_s / FULL.velocity_1_s
    )
    return HoldTuning(
        gains=gains,
        margin=margin,
        share=math.sqrt(stiffness_share),
        climb_share=softer * climb_share,
        loop=loop,
        age_s=age_s,
    )


class _Level(NamedTuple):
    """Gains, and the margin that the horizontal loop has with them."""

    gains: HoldGains
    margin: Margin


def _stiffest(hardest: HoldGains, loop: AttitudeLoop, age_s: float) -> _Level:
    """Of the shares of ``hardest``, those with the margin wanted that push back hardest against a displacement.

    The acceleration per metre is the product of the gains of position and velocity. Dead time bounds the gain of the
    velocity, a slow attitude that of the position: each is softened by itself.
    """
    tried = []
    best: _Level | None = None
    stiffness_share = 0.0
    for velocity_share in _LEVEL_SHARES:
        for position_share in _LEVEL_SHARES:
            if velocity_share * position_share <= stiffness_share:
                break
            gains = soften(hardest, position_share=position_share, velocity_share=velocity_share)
            found = _Level(gains, margin_of(horizontal_loop(gains, loop, age_s)))
            tried.append(found)
            if found.margin.meets(_WANTED):
                best = found
                stiffness_share = velocity_share * position_share
                break
    if best is not None:
        return best
    return max(tried, key=lambda one: one.margin.share_of(_WANTED))


def _hardest_climb(hardest: HoldGains, age_s: float) -> tuple[float, Margin]:
    """The first share of height's gains that has enough of a margin, else the one with the largest."""
    tried = []
    for share in _SHARES:
        margin = margin_of(vertical_loop(soften(hardest, climb_share=share), age_s))
        if margin.meets(_WANTED_CLIMB):
            return share, margin
        tried.append((share, margin))
    return max(tried, key=lambda one: one[1].share_of(_WANTED_CLIMB))
