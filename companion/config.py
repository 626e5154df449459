"""What does not change during a flight: vehicle, model, interface and every number of estimator, hold and offsets.

Where no source stands beside a number it is a choice of this project; what it was measured with is in docs/lab/hold.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import NamedTuple

from companion.adapt_options import Adapt, AdaptTuning
from companion.survey_box import SurveyBox
from models.frames import GRAVITY
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle


class Carrier(Enum):
    """How an offset travels to the autopilot."""

    ATTITUDE = "attitude"
    ACCELERATION = "acceleration"


class Base(Enum):
    """Whose setpoint the offset is added to."""

    HOLD = "hold"
    UPSTREAM = "upstream"


@dataclass(frozen=True, slots=True)
class TrackModel:
    """Noise of a track: ``acceleration_sd`` [unit/s^2] drives it, ``gate`` limits the normalised innovation squared."""

    acceleration_sd: float
    initial_rate_sd: float
    gate: float = 16.0
    restart_after: int = 5
    agree_within: float = 0.10
    """Consecutive outliers within this many units of each other restart the track there."""


@dataclass(frozen=True)
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
    max_tilt_rad: float = math.radians(15.0)
    """Of the hold, before offsets: 2.6 m/s^2."""
    pressed_tilt_rad: float = math.radians(24.0)
    """The same away from a wall that it cannot stop before, 4.4 m/s^2. Not everywhere: large tilts are answered later,
    and the hold that leans so far to all sides swings."""
    max_climb_acceleration_m_s2: float = 3.0
    max_integral_m_s2: float = 2.5
    """A steady 25 % of the weight: a wind of 10 m/s on a vehicle of 3 kg."""
    balance_s: float = 0.25
    """Time over which the integral goes to what the tilt is seen to balance, while a limit is met."""
    tilt_lead_s: float = 0.19
    """How far ahead velocity is predicted from the tilt that there is, in a loop that is 0.24 s late."""
    tilt_lead_share: float = 0.8
    """The same as a share of the loop's own lag, once that is known."""
    climb_lead_s: float = 0.05
    """The same vertically, from the acceleration that was asked for: about what motors are late."""
    tilt_mean_s: float = 0.8
    """A tilt that lasts longer than this balances something and accelerates nothing. At half of it the phase
    margin is 5 degrees lower, at twice of it a slow disturbance is answered later (docs/lab/hold.md)."""
    shape_s: tuple[float, float, float] = (0.25, 0.25, 0.12)
    """Time over which a change of the velocity target is fed forward as an acceleration, by axis NED."""
    target_age_s: float = 0.5
    """The velocity that goes with a position target counts for this long after it was sent; the position stays."""
    velocity_age_s: float = 1.2
    """A velocity target without a position lasts two and a half periods of its sender, at most this long: senders
    repeat it at 1 Hz or faster."""
    follow_m: float = 0.15
    """A target that leaps less than this is followed as it is; a larger leap is approached within the limits."""
    follow_m_s: float = 0.2
    """A target whose velocity leaps by more than this is followed by its place, not by the new velocity: a tilt that
    is 0.24 s late answers the leap too late, the hold swings, and runs past a target that stops as abruptly."""
    caught_up_m: float = 0.02
    caught_up_m_s: float = 0.03
    """An approach is over this near to the target in place and velocity."""
    jerk_m_s3: float = 3.0
    """Of an approach: 0.35 degrees of tilt from one setpoint to the next at 50 Hz, 0.9 with the lead."""
    closing_1_s: float = 1.0
    """Of an approach: speed per metre left, near the end; 5 cm take a second."""
    wanted_gain_margin: float = 1.6
    wanted_phase_margin_deg: float = 18.0
    """Gains are chosen to have at least these. Textbooks ask for 2 and 30 degrees (Astrom and Murray 2021, 10.3), which
    the full gains have on quick loops; on slow ones softer gains are drawn to a wall sooner than they would swing."""
    least_gain_margin: float = 1.25
    least_phase_margin_deg: float = 10.0
    """With less than these at the softest gains there is no hold."""
    least_share: float = 0.42
    """Of the full gains, to engage: softer, the hold is weaker than an autopilot's own (ArduPilot's PSC_POSXY_P 1.0
    times PSC_VELXY_P 2.0 is 2 1/s^2), and a wall's pull grows faster than it holds."""
    kept_share: float = 0.35
    """The same for a hold that flies already."""
    gap_s: float = 0.5
    """After a longer silence the vehicle may be anywhere: the way to the target begins where it is."""


@dataclass(frozen=True, slots=True)
class Tuning:
    """Numbers of the estimator, the hold and the offsets; SI."""

    # Estimation
    range_track: TrackModel = TrackModel(acceleration_sd=1.5, initial_rate_sd=0.5)
    rotor_track: TrackModel = TrackModel(
        acceleration_sd=6000.0, initial_rate_sd=2000.0, gate=25.0, restart_after=3, agree_within=400.0
    )
    range_delay_s: float = 0.03
    """Age of a range when it is stamped (a sensor's own averaging)."""
    range_sigma_m: float = 0.01
    range_sigma_share: float = 0.005
    velocity_sigma_m_s: float = 0.10
    rotor_delay_s: float = 0.03
    rotor_sigma_rpm: float = 15.0
    # How old an input may be before the offsets fade, or the hold lets go
    heartbeat_age_s: float = 3.0
    """Three heartbeats at the 1 Hz of the protocol."""
    attitude_age_s: float = 0.2
    position_age_s: float = 0.5
    position_fade_age_s: float = 0.28
    """Older than this the offsets fade, before the hold lets go. Above the 0.2 s of positions at 5 Hz."""
    range_age_s: float = 0.22
    """With ``fade_out_s`` and one setpoint, offsets are zero 0.5 s after the last reading; 10 Hz is enough."""
    rotor_age_s: float = 0.22
    upstream_age_s: float = 0.5
    lift_time_s: float = 2.0
    """Over which the modelled lift of a flying vehicle is averaged before it is compared with the weight."""
    lift_share: tuple[float, float] = (0.6, 1.6)
    """Modelled lift over weight: a third of payload, the ground's cushion and a coefficient that is a fifth off stay
    inside; a model or a file of another vehicle does not."""
    late_fade_s: float = 0.15
    """Attitudes or positions that arrive later than this by their own stamps fade the offsets: a hover offset moves by
    its own size within about 0.5 s, and the attitude loop behind it has some 20 degrees of phase left."""
    late_stop_s: float = 0.18
    """Later than this, for ``late_stop_for_s``, the hold lets go: at 0.2 s it swung into a wall 0.3 m away in the
    simulation (``link_late_0.2s`` of the fault campaign)."""
    late_stop_for_s: float = 0.2
    """On the vehicle's clock: a short burst after a gap of the link is caught up with instead."""
    surface_step_s: float = 1.5
    """After the ground or wall jumped, offsets stay away for this long."""
    # Fading
    fade_in_s: float = 1.0
    """As slowly as the integrators adapt, so that nothing is counted twice."""
    fade_out_s: float = 0.2
    """As fast as the slew rates of a vehicle file's defaults allow a full offset to go."""
    max_tilt_rad: float = math.radians(25.0)
    """Beyond, the small-angle law of the offsets no longer holds: they fade."""
    airborne_after_s: float = 1.0
    airborne_lift_share: float = 0.75
    """Of the weight: rotors that lift this much carry the vehicle, ground effect included."""
    idle_is_landed_s: float = 2.0
    carried_age_s: float = 0.3
    """Rotors that carried the weight so lately speak against a land detector."""
    # Hover thrust, learned while the autopilot flies
    hover_mean_s: float = 2.0
    """Time constant of the average."""
    hover_climb_m_s: float = 0.2
    """Faster than this vertically, the autopilot's thrust is no hover thrust."""
    hover_learned_s: float = 1.0
    """So much hovering under the autopilot gives a thrust to engage with: to 1 % on both firmwares' recordings."""
    hover_heard_age_s: float = 1.0
    hover_disagreement: float = 0.15
    """Parameter and vehicle file may differ by this share where nothing could be learned."""
    # Engagement
    settled_climb_m_s: float = 0.25
    settled_s: float = 1.0
    """A take-off is over when the vertical speed has been below that for so long."""
    balance_mean_s: float = 1.0
    """Average of the tilt that balances wind before the hold engages."""
    parting_s: float = 0.5
    """Letting go takes so long: level by degrees, or the place sent to the autopilot several times."""
    # When the hold swings by itself
    swing_softer: float = 0.6
    """Of the gains, after each swing that was noticed."""
    swing_levels: int = 3
    """So often the gains are softened; after one more swing the hold lets go."""
    swing_calm_s: float = 120.0
    """After so long without a swing the gains go one step back; after two swings twice as long, and so on."""
    swing_pause_s: float = 6.0
    """Offsets stay away for so long after a swing."""
    # Offsets
    gain: float = 0.95
    thrust_lead_s: float = 0.06
    """How far ahead the lift is looked up: what motors take to follow."""
    tilt_lead_s: float = 0.0
    """The same for side forces. Over-prediction costs more than it gives (docs/lab/hold.md)."""
    moment_stiffness_1_s2: float = 180.0
    """Closed-loop attitude stiffness over inertia with the rate integrator frozen (angle P x rate bandwidth)."""
    moment_washout_s: float = 1.0
    """The rate integrator owns a steady moment within about this time."""
    moment_limit_rad: float = math.radians(2.5)
    damping_share: float = 0.2
    """Of the loop's damping that delayed feed-forward towards a surface may take away."""
    upstream_damping_1_s: float = 2.0
    """Of an upstream controller's velocity loop: ArduPilot's PSC_VELXY_P; PX4's MPC_XY_VEL_P_ACC is 1.8."""
    residual_delay_s: float = 0.06
    """What is left of the delay of a side force behind the lead."""
    # Sending
    disturbance_period_s: float = 0.03
    """The model is asked this often, after a position, so that an attitude is answered without waiting for it."""
    max_decision_rate_hz: float = 110.0
    """A little above the 100 Hz that a companion link carries."""
    min_thrust_share: float = 0.3
    """Of hover thrust: the hold never commands less, so that the attitude stays controllable."""
    min_thrust: float = 0.05
    max_thrust_above_hover: float = 0.35
    max_thrust: float = 0.95
    hold: HoldGains = HoldGains()


class OffsetBounds(NamedTuple):
    """Of an offset, or of its change in a second: thrust as a share of full throttle, tilt and acceleration."""

    thrust: float
    tilt_rad: float
    acceleration_m_s2: float


@dataclass(frozen=True)
class PipelineConfig:
    """Everything ``step`` needs besides state and sample."""

    vehicle: Vehicle
    model: FanSurrogate
    tuning: Tuning = field(default_factory=Tuning)
    base: Base = Base.HOLD
    carrier: Carrier = Carrier.ATTITUDE
    dry_run: bool = False
    offsets: bool = True
    """False flies the bare hold: for comparison only."""
    survey: SurveyBox | None = None
    """The hold is moved through this box once it flies."""
    adapt: Adapt = Adapt.OFF
    """What the sizes measured in flight do to the offsets."""
    adapt_tuning: AdaptTuning = field(default_factory=AdaptTuning)

    @cached_property
    def most_offset(self) -> OffsetBounds:
        """How far an offset may go."""
        limits = self.vehicle.limits
        tilt = math.radians(limits.tilt_deg)
        return OffsetBounds(limits.thrust, tilt, GRAVITY * math.tan(tilt))

    @cached_property
    def offset_rates(self) -> OffsetBounds:
        """How fast an offset may change."""
        limits = self.vehicle.limits
        tilt = math.radians(limits.slew_tilt_deg_per_s)
        return OffsetBounds(limits.slew_thrust_per_s, tilt, GRAVITY * tilt)

    @property
    def damping_1_s(self) -> float:
        """Velocity damping of the loop in charge."""
        return self.tuning.hold.velocity_1_s if self.base is Base.HOLD else self.tuning.upstream_damping_1_s
