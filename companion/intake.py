"""From a sample to the state: what is heard, and what others ask for."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from companion.adaptation import begin, gather
from companion.adaptation.gates import Situation
from companion.config import Base, PipelineConfig
from companion.control import engagement, hover_thrust, swing_detector
from companion.control.hover_thrust import HoverThrust
from companion.control.landed import AIRBORNE_AFTER_S, IN_AIR
from companion.control.plant import hear_position
from companion.control.position_hold import shifted
from companion.control.position_target import read_target
from companion.control.reasons import Notice
from companion.control.survey import Whereabouts, aborted, advance, as_message
from companion.control.wall_guard import level_wall
from companion.estimation import estimator as est
from companion.estimation import height_drift
from companion.estimation.estimates import blank_estimates
from companion.estimation.felt_motion import feel
from companion.estimation.wall_drift import corrected
from companion.mavlink import AUTOPILOT_COMPONENT, NO_AUTOPILOT, OWN_COMPONENT, samples
from companion.mavlink.firmware import Stack
from companion.mavlink.samples import Heartbeat, Sample
from companion.state.learned import Learned
from companion.state.pipeline_state import PipelineState
from companion.state.requests import Requests
from companion.surroundings import DISTURBANCE_PERIOD_S, compare_ranges, renew_disturbance
from companion.survey_box import SurveyBox
from models.common.frozen_copy import with_changes

_HOVER_CLIMB_M_S = 0.2
"""Faster than this vertically, the autopilot's thrust is no hover thrust."""
_REBOOT_S = 1.0
"""The autopilot's own stamps come in order to some 0.3 s: further back, its clock has started anew."""
_STAMPED = (samples.Attitude, samples.LocalPosition, samples.AttitudeTarget)
"""What carries the autopilot's own stamp of milliseconds and comes in order."""


def initial_state(config: PipelineConfig) -> PipelineState:
    """The state before anything is heard.

    Parameters
    ----------
    config : PipelineConfig
        Vehicle, model and interface.

    Returns
    -------
    PipelineState
        For the first ``step``.

    Examples
    --------
    >>> import companion, models
    >>> from companion.vehicles import default_vehicle
    >>> config = companion.PipelineConfig(vehicle=default_vehicle(), model=models.load())
    >>> companion.initial_state(config).estimates.position is None
    True
    """
    learned = Learned(adaptation=begin.initial(config))
    return PipelineState(estimates=blank_estimates(config.vehicle), learned=learned)


def take_in(
    state: PipelineState, sample: Sample, config: PipelineConfig
) -> tuple[PipelineState, bool]:
    """The state after a sample, and whether it was news: False for one that a newer one has overtaken.

    Stamps of the autopilot that go back by more than a second are a reboot: all that was known is forgotten, except the
    wish to stop. A gap is none: what was learned stays.
    """
    if state.t_s <= 0.0 < sample.t_s and state.heard.heartbeat is not None:
        # Heard before the first stamp, so at an unknown time, moments ago.
        heartbeat = dataclasses.replace(state.heard.heartbeat, t_s=sample.t_s)
        state = with_changes(state, heard=with_changes(state.heard, heartbeat=heartbeat))
    if isinstance(sample, _STAMPED):
        if sample.t_s < state.stamped_s - _REBOOT_S:
            requests = Requests(stopping=state.requests.stopping)
            state = with_changes(initial_state(config), requests=requests)
        newest = {
            samples.Attitude: state.estimates.attitude,
            samples.LocalPosition: state.estimates.position,
        }
        if (seen := newest.get(type(sample))) is not None and sample.t_s < seen.t_s:
            return state, False  # out of order: a newer one has been taken in
        if isinstance(sample, samples.Attitude) and seen is not None and sample.t_s == seen.t_s:
            return state, False  # PX4 says it twice, as ATTITUDE and as ATTITUDE_QUATERNION
    state = _take(state, sample, config)
    if config.survey is not None:
        state = _surveyed(state, sample, config, config.survey)
    if (
        isinstance(sample, samples.LocalPosition)
        and sample.t_s - state.air.disturbance_s >= DISTURBANCE_PERIOD_S
    ):
        state = compare_ranges(renew_disturbance(state, sample.t_s, config), config)
    return state, True


def _take(state: PipelineState, sample: Sample, config: PipelineConfig) -> PipelineState:
    now = max(state.t_s, sample.t_s)
    estimates = state.estimates
    # What comes most often is asked for first.
    match sample:
        case samples.Imu():
            return _take_imu(state, sample, config)
        case samples.Attitude():
            stamped_s = max(state.stamped_s, sample.t_s)
            estimates = est.take_attitude(estimates, sample)
            return with_changes(state, t_s=now, stamped_s=stamped_s, estimates=estimates)
        case samples.LocalPosition():
            return _take_position(state, sample, now)
        case samples.Range() | samples.Ring():
            return with_changes(state, t_s=now, estimates=est.take_range(estimates, sample, config))
        case samples.RotorSpeeds():
            return with_changes(
                state, t_s=now, estimates=est.take_rotors(estimates, sample, config)
            )
        case samples.ServoOutput() if sample.port == config.vehicle.servo_port:
            return with_changes(state, t_s=now, estimates=est.take_servo(estimates, sample, config))
        case samples.Heartbeat() if (
            sample.component == AUTOPILOT_COMPONENT and sample.autopilot != NO_AUTOPILOT
        ):
            return _take_heartbeat(state, sample, now)
        case samples.Battery():
            return with_changes(state, t_s=now, estimates=with_changes(estimates, battery=sample))
        case samples.Pressure():
            return with_changes(state, t_s=now, estimates=with_changes(estimates, pressure=sample))
        case samples.EstimatorStatus():
            return with_changes(
                state,
                t_s=now,
                estimates=with_changes(estimates, trust=estimates.trust.after(sample)),
            )
        case samples.EscTemperatures():
            return with_changes(
                state, t_s=now, estimates=est.take_temperatures(estimates, sample.temperature_c)
            )
        case samples.AttitudeTarget():
            stamped_s = max(state.stamped_s, sample.t_s)
            hover = _learned_hover(state, sample)
            learned = with_changes(state.learned, hover=hover)
            return with_changes(state, t_s=now, stamped_s=stamped_s, learned=learned)
        case samples.LandedState():
            airborne = state.air.airborne._replace(landed_state=sample.landed_state)
            air = with_changes(state.air, airborne=airborne)
            return with_changes(state, t_s=now, air=air)
        case _:
            return _take_request(state, sample, config)


def _take_heartbeat(state: PipelineState, sample: Heartbeat, now_s: float) -> PipelineState:
    seen = engagement.hear_heartbeat(state.heard.engagement, sample)
    if seen.mode != state.heard.engagement.mode:
        # Another mode, another beginning: a hold that swung under the last one may try again.
        state = with_changes(
            state,
            plant=with_changes(state.plant, swing=swing_detector.SwingDetector()),
            held=with_changes(state.held, left=None),
        )
    heard = with_changes(state.heard, heartbeat=sample, engagement=seen)
    return with_changes(state, t_s=now_s, heard=heard)


def _situation(state: PipelineState) -> Situation:
    """What decides whether sizes may be learned now."""
    air = state.air
    return Situation(
        estimates=state.estimates,
        disturbance=air.disturbance,
        disturbance_s=air.disturbance_s,
        airborne_since_s=air.airborne.since_s,
        landed_state=air.airborne.landed_state,
    )


def _take_imu(state: PipelineState, sample: samples.Imu, config: PipelineConfig) -> PipelineState:
    felt = feel(state.felt, state.estimates.rows, sample)
    if state.learned.adaptation is None:
        return with_changes(state, felt=felt)
    adaptation = gather.hear(state.learned.adaptation, _situation(state), sample, config)
    learned = with_changes(state.learned, adaptation=adaptation)
    return with_changes(state, felt=felt, learned=learned)


def _take_position(
    state: PipelineState, sample: samples.LocalPosition, now_s: float
) -> PipelineState:
    held = state.held
    hold = held.hold
    drift = height_drift.NO_DRIFT
    wall_drift = held.wall_drift
    timing = hear_position(state.plant.timing, sample.t_s, sample.late_s)
    if hold is not None:
        drift, sample = height_drift.hear(held.drift, sample)
        wall_drift, sample = corrected(wall_drift, sample, state.felt)
    estimates = est.take_position(state.estimates, sample)
    stamped_s = max(state.stamped_s, sample.t_s)
    reset = estimates.reset
    if hold is not None and reset is not None and reset.t_s == sample.t_s:
        # The autopilot set its position anew: the hold point moves with it, the vehicle itself did not move.
        hold = shifted(hold, reset.by_ned)
        if held.wall is not None:
            held = with_changes(held, wall=held.wall.shifted(reset.by_ned))
    seen_anew = drift is not held.drift or wall_drift is not held.wall_drift
    if seen_anew or hold is not held.hold:
        held = with_changes(held, drift=drift, wall_drift=wall_drift, hold=hold)
    return with_changes(
        state,
        t_s=now_s,
        stamped_s=stamped_s,
        estimates=estimates,
        plant=with_changes(state.plant, timing=timing),
        held=held,
    )


def _take_request(state: PipelineState, sample: Sample, config: PipelineConfig) -> PipelineState:
    """What others ask for: parameters' answers, targets for the hold, an upstream controller's setpoints."""
    match sample:
        case samples.Parameter():
            parameters = {**state.heard.parameters, sample.name: sample.value}
            return with_changes(state, heard=with_changes(state.heard, parameters=parameters))
        case samples.SetPositionTarget() if sample.target_component == OWN_COMPONENT:
            return _retarget(state, sample)
        case samples.SetAttitudeTarget() if (
            config.base is Base.UPSTREAM and sample.component != OWN_COMPONENT
        ):
            return with_changes(state, requests=with_changes(state.requests, upstream=sample))
    return state


def _surveyed(
    state: PipelineState, sample: Sample, config: PipelineConfig, box: SurveyBox
) -> PipelineState:
    """A survey moves the hold by the messages that a pilot would send; a pilot's own message ends it."""
    requests = state.requests
    if isinstance(sample, samples.SetPositionTarget) and sample.target_component == OWN_COMPONENT:
        survey = aborted(requests.survey, "a target came from outside")
        return with_changes(state, requests=with_changes(requests, survey=survey))
    position = state.estimates.position
    disturbance = state.air.disturbance
    if not isinstance(sample, samples.LocalPosition) or position is None:
        return state
    height = math.nan
    wall = math.nan
    towards = None
    if disturbance is not None:
        if disturbance.ground.known:
            height = min(disturbance.h_m)
        else:
            height = math.nan
        if disturbance.wall.known:
            wall = min(disturbance.d_m)
        else:
            wall = math.nan
        towards = level_wall(disturbance)
    seen = Whereabouts(
        t_s=sample.t_s,
        engaged=state.held.hold is not None,
        position=np.asarray(position.position_ned),
        height_m=height,
        wall_m=wall,
        towards=towards,
    )
    survey, wanted = advance(requests.survey, box, seen)
    state = with_changes(state, requests=with_changes(requests, survey=survey))
    if wanted is None:
        return state
    return _take(state, as_message(wanted, sample, OWN_COMPONENT), config)


def _retarget(state: PipelineState, sample: samples.SetPositionTarget) -> PipelineState:
    """A target moves the hold that is engaged; one that came before is not kept."""
    position = state.estimates.position
    rows = state.estimates.rows
    hold = state.held.hold
    if hold is None or state.requests.stopping or position is None or rows is None:
        return state
    yaw = math.atan2(rows[1][0], rows[0][0])
    target = read_target(sample, hold.target, position.position_ned, yaw)
    if target is None:
        return with_changes(state, notice=(Notice.FRAME_REFUSED, sample.t_s))
    held = with_changes(state.held, hold=hold._replace(target=target))
    return with_changes(state, held=held)


def _learned_hover(state: PipelineState, sample: samples.AttitudeTarget) -> HoverThrust:
    """The autopilot's own hover command, free of what the ground gives, while it still flies by itself."""
    position = state.estimates.position
    heard = state.heard
    own = heard.heartbeat is not None and (
        heard.stack is not Stack.PX4 or not heard.takes_setpoints
    )
    flying = (
        own
        and state.held.hold is None
        and state.sending.hand_over is None
        and state.requests.upstream is None
    )
    hovers = (
        flying
        and state.air.airborne.since_s < sample.t_s - AIRBORNE_AFTER_S
        and state.air.airborne.landed_state in (0, IN_AIR)
        and position is not None
        and abs(position.velocity_ned[2]) <= _HOVER_CLIMB_M_S
    )
    if not hovers:
        return hover_thrust.heard(state.learned.hover, sample.t_s, sample.thrust)
    return hover_thrust.learn(
        state.learned.hover, sample.t_s, sample.thrust, cushion=state.sending.offsets.wanted.thrust
    )
