"""What does not change during a flight: vehicle, model, interface and the few numbers of the control law."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from companion.estimation.kalman import TrackModel
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


@dataclass(frozen=True)
class Tuning:
    """Numbers of the estimator, the hold and the offsets; SI. Defaults are what was flown and measured."""

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
    # How old an input may be before the offsets fade
    attitude_age_s: float = 0.2
    position_age_s: float = 0.5
    range_age_s: float = 0.3
    rotor_age_s: float = 0.4
    upstream_age_s: float = 0.5
    late_fade_s: float = 0.15
    """Attitudes or positions that arrive later than this by their own stamps fade the offsets: a hover offset moves by
    its own size within about 0.5 s, and the attitude loop behind it has some 20 degrees of phase left."""
    late_stop_s: float = 0.3
    """Later than this, for ``late_stop_for_s``, the hold lets go: its velocity loop (4 1/s) turns unstable there."""
    late_stop_for_s: float = 0.2
    """On the vehicle's clock: a short burst after a gap of the link is caught up with instead."""
    surface_step_s: float = 1.5
    """After the ground or wall jumped, offsets stay away for this long."""
    # Fading
    fade_in_s: float = 1.0
    fade_out_s: float = 0.4
    airborne_after_s: float = 1.0
    airborne_lift_share: float = 0.75
    idle_is_landed_s: float = 2.0
    # Offsets
    gain: float = 0.95
    thrust_lead_s: float = 0.06
    lean_lead_s: float = 0.0
    moment_stiffness_1_s2: float = 180.0
    """Closed-loop attitude stiffness over inertia with the rate integrator frozen (angle P x rate bandwidth)."""
    moment_washout_s: float = 1.0
    """The rate integrator owns a steady moment within about this time."""
    moment_limit_deg: float = 2.5
    hold_damping_1_s: float = 3.0
    """Velocity damping over mass that the loop in charge provides; bounds the gain near walls and ceilings."""
    residual_delay_s: float = 0.06
    max_decision_rate_hz: float = 110.0


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
