import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from flying import CONFIG, DOWN, PlainModel, bench
from hypothesis import given, settings
from hypothesis import strategies as st

import companion.settle as settle_module
from companion.config import Base, Carrier, PipelineConfig
from companion.control import attitude_response, swing_detector
from companion.control.compensation import Offset, slewed
from companion.control.reasons import Reason
from companion.disturbance.stable_gain import GAIN
from companion.mavlink.samples import (
    Attitude,
    AttitudeTarget,
    Heartbeat,
    LandedState,
    LocalPosition,
    Parameter,
    Range,
    RangeVerdict,
    RotorSpeeds,
    SetAttitudeTarget,
    SetPositionTarget,
)
from companion.mavlink.setpoints import AttitudeCommand, PositionCommand
from companion.pipeline import answer, initial_state, step, stopped
from companion.settle import settle
from companion.state.pipeline_state import PipelineState
from companion.telemetry.status import named_values
from models.common.frames import quaternion_from_euler


def test_near_the_ground_thrust_is_taken_off_and_at_the_wall_it_leans_away():
    b = bench(height=0.3, wall=0.3)
    decision = b.run(4.0)
    assert decision.reasons == ()
    assert decision.authority == 1.0
    # By hand: h = 0.3 gives +5 % lift, taken out multiplicatively at gain 0.95.
    lift = 1.0 + 0.05 * GAIN
    assert decision.disturbance.wrench[2] == pytest.approx(-0.05 * 2 * 22.555, rel=0.01)
    assert decision.offset.thrust < 0.0
    slope_share = (1.0 / lift - 1.0) * 1.0
    assert decision.offset.thrust == pytest.approx(slope_share / 1.55, rel=0.15)
    # The wall is on the right and pulls there: lean left.
    assert decision.disturbance.wrench[1] > 0.0
    assert decision.offset.roll < 0.0
    assert decision.offset.roll == pytest.approx(
        -math.atan2(
            decision.disturbance.wrench[1] * decision.disturbance.trust * decision.disturbance.gain,
            45.11,
        ),
        rel=0.05,
    )
    assert abs(decision.offset.pitch) < 1e-6


def test_far_from_everything_the_offset_is_exactly_nothing():
    decision = bench(height=5.0, wall=6.0).run(3.0)
    assert decision.reasons == ()
    assert (decision.offset.thrust, decision.offset.roll, decision.offset.pitch) == (0.0, 0.0, 0.0)
    assert decision.command is not None


def test_a_wall_beyond_the_sensors_range_is_no_wall_and_no_refusal():
    b = bench(height=0.3)
    b.range_verdict = RangeVerdict.ABOVE_MAX
    decision = b.run(2.0)
    assert decision.reasons == ()
    assert math.isinf(decision.disturbance.d_m[0])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"armed": False}, Reason.NOT_ARMED),
        ({"mode": 5}, Reason.WRONG_MODE),
        ({"landed": 1}, Reason.LANDED),
        ({"rpm": 2500.0, "landed": 0}, Reason.LANDED),
        ({"guid_options": 0.0}, Reason.THRUST_IS_CLIMB_RATE),
        ({"guid_options": None}, Reason.THRUST_UNKNOWN),
        ({"autopilot": 0}, Reason.STACK_UNKNOWN),
        ({"send_position": False}, Reason.POSITION_STALE),
        ({"autopilot": 12, "vehicle_type": 0}, Reason.TYPE_IGNORED),
    ],
)
def test_what_holds_back_everything_sends_nothing(change, reason):
    b = bench(**change)
    for _ in range(150):
        decision = b.tick()
        assert decision.command is None
    assert reason in decision.reasons
    assert decision.offset.thrust == 0.0


@pytest.mark.parametrize(
    ("change", "reason", "within"),
    [
        ({"send_range": False}, Reason.RANGE_STALE, 0.3 + 0.5),
        ({"send_rpm": False}, Reason.RPM_MISSING, 0.4 + 0.5),
        ({"range_verdict": RangeVerdict.BELOW_MIN}, Reason.RANGE_STALE, 0.3 + 0.5),
        ({"roll": 0.5}, Reason.TILTED, 0.5),
    ],
)
def test_a_lost_input_fades_the_offset_to_zero_within_half_a_second_of_its_age_limit(
    change, reason, within
):
    b = bench(height=0.2, wall=0.3)
    before = b.run(4.0)
    assert before.offset.thrust < -0.01
    for name, value in change.items():
        setattr(b, name, value)
    last = b.t
    trace = []
    while b.t - last < within + 0.021:
        trace.append(b.tick())
    assert reason in trace[-1].reasons
    assert (trace[-1].offset.thrust, trace[-1].offset.roll) == (0.0, 0.0)
    assert trace[-1].command is not None, "the base goes on flying"
    sizes = [abs(d.offset.thrust) for d in trace]
    assert max(abs(np.diff(sizes))) < 0.12 * abs(before.offset.thrust), (
        "it fades, it does not switch"
    )


def test_missing_sensors_are_named():
    b = bench(send_range=False)
    assert Reason.RANGE_MISSING in b.run(2.0).reasons


def test_take_off_is_flown_without_offsets_until_a_second_in_the_air():
    b = bench(height=0.05, rpm=0.0, landed=1)
    for _ in range(100):
        b.rpm = min(b.rpm + 50.0, 4000.0)
        decision = b.tick()
        assert decision.command is None
        assert decision.offset.thrust == 0.0
    b.landed = 2
    lifted = b.t
    while b.t < lifted + 0.9:
        assert b.tick().offset.thrust == 0.0


def test_a_step_of_the_floor_is_named_and_not_compensated():
    b = bench(height=1.0)
    b.run(3.0)
    b.height = 0.3  # a table under the vehicle: the range jumps, the vehicle does not
    seen = [b.tick() for _ in range(40)]
    assert any(Reason.SURFACE_STEP in d.reasons for d in seen)


def test_another_system_of_the_same_type_and_a_ground_station_change_nothing():
    b = bench()
    b.run(2.0)
    state = b.state
    ground_station = Heartbeat(b.t, 255, 190, False, 0, 8, 6)
    after, decision = step(state, ground_station, b.config)
    assert decision is None
    assert after.heard.heartbeat == state.heard.heartbeat


def test_no_new_input_no_new_output():
    b = bench()
    b.run(2.0)
    for sample in (
        LocalPosition(b.t, 1, 1, (0, 0, -1), (0, 0, 0)),
        RotorSpeeds(b.t, 1, 1, 1, (4000.0,) * 4, "RPM"),
        b.range(DOWN, 0.2),
        Parameter(b.t, 1, 1, "X", 1.0),
    ):
        b.state, decision = step(b.state, sample, b.config)
        assert decision is None


def test_an_attitude_that_is_sent_twice_counts_once() -> None:
    """PX4 sends each as ATTITUDE and as ATTITUDE_QUATERNION, of the same time."""
    once = bench(roll=0.02)
    once.run(2.0)
    twice = bench(roll=0.02)
    for _ in range(100):
        twice.tick()
        assert twice.feed(replace(twice.state.estimates.attitude, source="ATTITUDE")) is None
    assert twice.state.learned.balance.acceleration == once.state.learned.balance.acceleration
    assert twice.state.learned.balance.acceleration[1] == pytest.approx(0.2, abs=0.01)
    measured, expected = twice.state.plant.response.bank, once.state.plant.response.bank
    assert all(np.array_equal(a, b) for a, b in zip(measured, expected, strict=True))


def test_a_reboot_forgets_everything_but_the_wish_to_stop():
    b = bench()
    b.run(3.0)
    b.state = stopped(b.state)
    b.state, _ = step(b.state, LocalPosition(1.0, 1, 1, (0, 0, -1), (0, 0, 0)), b.config)
    assert b.state.held.hold is None
    assert b.state.heard.heartbeat is None
    assert b.state.requests.stopping


def test_stopping_fades_out_within_half_a_second():
    b = bench(height=0.2)
    b.run(4.0)
    b.state = stopped(b.state)
    decision = b.run(0.5)
    assert Reason.STOPPING in decision.reasons
    assert decision.offset.thrust == 0.0
    assert decision.command is not None


def test_out_of_domain_fades():
    b = bench(model=PlainModel(believed=0.0), height=0.2)
    decision = b.run(3.0)
    assert Reason.OUT_OF_DOMAIN in decision.reasons
    assert decision.offset.thrust == 0.0


@pytest.mark.parametrize("believed", [0.1, 1.0])
def test_what_is_published_is_what_is_applied(believed):
    """With trust 0.1 a tenth of the disturbance is cancelled, and cc_auth says so."""
    b = bench(model=PlainModel(believed=believed), height=0.3, wall=0.3)
    decision = b.run(4.0)
    published = dict(named_values(decision))["cc_auth"]
    assert published == pytest.approx(believed * decision.disturbance.gain, abs=0.01)
    assert published == pytest.approx(-decision.offset.thrust / full_thrust(), rel=0.06)
    b.state = stopped(b.state)
    assert dict(named_values(b.run(1.0)))["cc_auth"] == 0.0


def full_thrust():
    """By hand: thrust that takes off 5 % of lift, at the slope of the shipped vehicle's thrust."""
    return (1.0 - 1.0 / 1.05) / 1.55


def test_an_offset_at_its_limit_is_published_as_the_part_that_passed():
    wanted = Offset(thrust=0.0, roll=math.radians(16.0), share=0.8)
    limited = Offset()
    for _ in range(100):
        limited = slewed(limited, wanted, CONFIG, 0.02)
    assert limited.share == pytest.approx(0.4, abs=1e-6)


def test_the_pilots_target_moves_the_hold():
    b = bench(height=1.0)
    b.run(2.0)
    mask = 64 | 128 | 256 | 1024 | 2048
    target = SetPositionTarget(
        b.t, 255, 190, mask, 1, (1.0, 0.0, -1.0), (0.3, 0.0, 0.0), (0, 0, 0), 0.0, 1, 191
    )
    b.feed(target)
    decision = b.run(0.1)
    assert decision.base.pitch < -0.02, "nose down to go north"
    b.feed(replace(target, target_component=1, position=(-9.0, 0.0, -1.0)))
    assert b.state.held.hold.target.position[0] == 1.0, "not addressed to the companion"


def test_the_hover_thrust_is_learned_while_the_autopilot_flies_and_free_of_the_cushion():
    b = bench(height=2.0, mode=5)
    for _ in range(300):
        b.tick()
        b.feed(AttitudeTarget(b.t, 1, 1, (1, 0, 0, 0), 0.437))
    assert b.state.learned.hover.learned == pytest.approx(0.437, abs=0.002)
    b.mode = 4
    decision = b.run(0.5)
    assert decision.base.thrust == pytest.approx(0.437, abs=0.01)


def test_an_upstream_stream_is_forwarded_with_the_offset_added():
    b = bench(base=Base.UPSTREAM, height=0.3, wall=0.3)
    decision = b.run(4.0)
    assert decision.command.thrust == pytest.approx(0.5 + decision.offset.thrust)
    assert decision.offset.thrust < 0.0
    assert decision.command.q_ned_frd[1] == pytest.approx(
        math.sin(decision.offset.roll / 2), abs=1e-6
    )
    assert np.linalg.norm(decision.command.q_ned_frd) == pytest.approx(1.0)
    own = SetAttitudeTarget(b.t, 1, 191, 7, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.5, 1, 1)
    assert b.feed(own) is None, "our own echo is no upstream setpoint"


def test_a_silent_upstream_is_named_and_nothing_is_sent():
    b = bench(base=Base.UPSTREAM)
    b.run(3.0)
    q = (1.0, 0.0, 0.0, 0.0)
    assert b.feed(Attitude(b.t + 0.1, 1, 1, q, (0.0, 0.0, 0.0), "ATTITUDE")) is None
    decision = b.feed(Attitude(b.t + 0.6, 1, 1, q, (0.0, 0.0, 0.0), "ATTITUDE"))
    assert Reason.UPSTREAM_STALE in decision.reasons
    assert decision.command is None


def test_acceleration_is_for_px4_and_refused_on_ardupilot():
    b = bench(carrier=Carrier.ACCELERATION, height=0.3, autopilot=12, mode=6 << 16)
    decision = b.run(4.0)
    assert isinstance(decision.command, PositionCommand)
    assert decision.command.acceleration_ned[2] > 0.1, "the cushion lifts: push down"
    b = bench(carrier=Carrier.ACCELERATION)
    decision = b.run(3.0)
    assert decision.command is None
    assert Reason.CARRIER_REFUSED in decision.reasons


def test_offsets_stay_within_the_vehicles_limits_and_slew():
    strong = bench(height=0.1, wall=0.25)
    limits = strong.config.vehicle.limits
    old = 0.0
    for _ in range(300):
        decision = strong.tick()
        assert abs(decision.offset.thrust) <= limits.thrust
        assert abs(decision.offset.roll) <= math.radians(limits.tilt_deg)
        assert abs(decision.offset.thrust - old) <= 0.02 * limits.slew_thrust_per_s + 0.02
        old = decision.offset.thrust


floats = st.floats(-1e4, 1e4) | st.sampled_from([math.nan, math.inf, -math.inf, 0.0])
times = st.floats(9.0, 12.0)
unit = st.floats(-3.2, 3.2).map(lambda a: quaternion_from_euler(a, a / 3, a / 2))


def range_down(t, distance, verdict):
    """A reading downwards."""
    return Range(
        t,
        1,
        1,
        direction_frd=DOWN,
        orientation=25,
        sensor_id=0,
        distance_m=distance,
        min_m=0.1,
        max_m=8.0,
        sigma_m=None,
        quality=None,
        verdict=verdict,
        source="x",
    )


samples = st.one_of(
    st.builds(lambda t, q: Attitude(t, 1, 1, q, (0.0, 0.0, 0.0), "ATTITUDE"), times, unit),
    st.builds(
        lambda t, a, b: LocalPosition(t, 1, 1, (a, b, a), (b, a, b)), times, st.floats(-1e3, 1e3), st.floats(-9, 9)
    ),
    st.builds(
        range_down,
        times, floats, st.sampled_from(RangeVerdict),
    ),
    st.builds(lambda t, r: RotorSpeeds(t, 1, 1, 1, (r, 4000.0, r, 4000.0), "x"), times, floats),
    st.builds(
        lambda t, armed, m: Heartbeat(t, 1, 1, armed, m, 3, 2), times, st.booleans(), st.sampled_from([4, 5])
    ),
    st.builds(lambda t, s: LandedState(t, 1, 1, s), times, st.integers(0, 4)),
    st.builds(lambda t, x: AttitudeTarget(t, 1, 1, (1, 0, 0, 0), x), times, floats),
    st.builds(
        lambda t, x, m: SetPositionTarget(t, 255, 1, m, 1, (x, x, x), (x, x, x), (x, x, x), x, 1, 191),
        times, floats, st.integers(0, 4095),
    ),
)  # fmt: skip


@cache
def engaged() -> tuple[PipelineState, PipelineConfig]:
    """State and configuration of a hold that has flown for a while; both never change."""
    b = bench()
    b.run(2.5)
    return b.state, b.config


@settings(max_examples=150, deadline=None)
@given(st.lists(samples, max_size=80))
def test_no_stream_of_samples_makes_an_unsendable_command(stream):
    state, config = engaged()
    for sample in stream:
        state, decision = step(state, sample, config)
        if decision is None or decision.command is None:
            continue
        assert isinstance(decision.command, AttitudeCommand)
        assert np.linalg.norm(decision.command.q_ned_frd) == pytest.approx(1.0, abs=1e-6)
        assert 0.05 <= decision.command.thrust <= 0.95
        assert abs(decision.offset.thrust) <= config.vehicle.limits.thrust


def test_the_state_is_never_changed_in_place():
    state = initial_state(CONFIG)
    twin = initial_state(CONFIG)
    step(state, Attitude(1.0, 1, 1, (1.0, 0.0, 0.0, 0.0), (0, 0, 0), "ATTITUDE"), CONFIG)
    assert state == twin


def test_what_only_later_setpoints_depend_on_waits_until_the_setpoint_has_left(monkeypatch):
    b = bench()
    b.run(3.0)
    assert b.state.held.hold is not None
    done = []
    watched = {settle_module: "tune", swing_detector: "watch", attitude_response: "hear_tilt"}
    for module, name in watched.items():
        was = getattr(module, name)
        monkeypatch.setattr(
            module, name, lambda *a, was=was, name=name: (done.append(name), was(*a))[1]
        )
    commands = 0

    def feed(sample):
        nonlocal commands
        done.clear()
        state, decision = answer(b.state, sample, b.config)
        commands += decision is not None and decision.command is not None
        assert not done, "nothing of this before the setpoint leaves"
        b.state = settle(state, sample, decision, b.config)
        seen.update(done)
        return decision

    seen = set()
    monkeypatch.setattr(b, "feed", feed)
    b.run(1.5)
    assert commands == 75
    assert seen == set(watched.values()), "all of it once the setpoint has left"
