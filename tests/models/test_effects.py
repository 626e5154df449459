"""The catalogue: names, shapes, signs, and the same wrench for one instant as for a record."""

from __future__ import annotations

import re
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import models
from companion import vehicles
from companion.vehicles import default_vehicle
from models.air_state import AirState, blank_state
from models.common.errors import ModelError
from models.common.frames import AXES, Array
from models.effects import (
    AdoptedEffect,
    Context,
    FlightUse,
    adopted,
    adopted_wrench,
    catalogue,
    corrected_state,
    get,
)
from models.effects.momentum_thrust import induced
from models.vehicle import Throttle, load_vehicle

NAMES = [effect.name for effect in catalogue()]
AGREED = """
ceiling second_wall partial_ground wind rotor_drag body_drag vertical_inflow air_density thrust_scale fan_imbalance
payload cg_offset range_offset imu_bias thermal_derating battery_sag gyroscopic ground_effect wall_effect motor_lag
contact slung_load rate_damping flapping_moment rotor_inertia momentum_thrust trim_moment
"""


def flight(n: int = 200) -> AirState:
    """A record with everything measured."""
    vehicle = default_vehicle()
    t = np.arange(n) * 0.1
    wave = np.sin(t)
    blank = blank_state((n,), len(vehicle.fans), len(vehicle.rotors))
    h = np.repeat((0.5 + 0.3 * wave)[:, None], len(vehicle.fans), axis=1)
    return replace(
        blank, time_s=t, velocity_ned=np.stack([wave, -wave, 0.3 * wave], axis=1), h_m=h, d_m=h + 0.2,
        ceiling_m=np.full_like(h, 0.4), second_d_m=h + 0.3,
        second_bearing_rad=np.full(n, 1.5), ranges_m=np.full((n, 6), 0.8), rates=np.full((n, 3), 0.2),
        rpm=np.full_like(blank.rpm, 4000.0) + 50.0 * wave[:, None], servo_us=np.full((n, 16), 1500.0),
        battery_voltage_v=np.linspace(25.0, 22.0, n), battery_current_a=np.full(n, 50.0),
        esc_temperature_c=np.linspace(30.0, 70.0, n), pressure_pa=np.full(n, 95000.0),
        air_temperature_c=np.full(n, 25.0), position_ned=np.stack([wave, wave, -h[:, 0]], axis=1),
    )  # fmt: skip


@pytest.fixture(scope="module")
def ctx() -> Context:
    """That record with the shipped model."""
    return Context(state=flight(), vehicle=default_vehicle(), model=models.load())


def fz(name: str, ctx: Context, **parameters: float) -> float:
    """Mean vertical force of an adopted effect."""
    return float(adopted_wrench([AdoptedEffect(name, parameters)], ctx)[:, 2].mean())


def test_the_agreed_names_are_all_there() -> None:
    assert set(AGREED.split()) <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_an_entry_is_complete_and_its_regressors_have_the_declared_shape(
    name: str, ctx: Context
) -> None:
    effect = get(name)
    for text in (effect.equation, effect.sign, effect.excite):
        assert len(text) > 3
    assert re.search(
        r"\n\nValid: .{4,}\nSource: .{4,}",
        import_module(f"models.effects.{name}").__doc__ or "",
        re.DOTALL,
    )
    assert effect.coefficients
    assert set(effect.axes) <= set(AXES)
    assert effect.channels
    assert all(c.least(ctx) < c.most(ctx) for c in effect.coefficients)
    if effect.lacking(ctx) is not None:
        pytest.skip(f"this record cannot show it: {effect.lacking(ctx)}")
    for shape in list(effect.shape_grid(ctx))[:3]:
        assert len(shape) == len(effect.shapes)
        x = effect.regressors(ctx, shape)
        assert x.shape == (len(ctx.state), 6, len(effect.coefficients))


@pytest.mark.parametrize(
    "name", ["wind", "payload", "thrust_scale", "ceiling", "cg_offset", "rotor_drag"]
)
def test_one_instant_gives_what_the_record_gives_there(name: str, ctx: Context) -> None:
    effect = get(name)
    shape = next(iter(effect.shape_grid(ctx)))
    parameters = effect.parameters(np.full(len(effect.coefficients), 0.5), shape)
    whole = effect.wrench(ctx, parameters)
    now = Context(state=ctx.state.take(7), vehicle=ctx.vehicle, model=ctx.model)
    assert effect.wrench(now, parameters) == pytest.approx(whole[7], abs=1e-9)


def test_signs(ctx: Context) -> None:
    assert fz("thrust_scale", ctx, scale=0.1) < 0.0  # more lift
    assert fz("payload", ctx, mass=0.5) == pytest.approx(
        0.5 * 9.80665, rel=0.01
    )  # heavier: less lift
    assert fz("ceiling", ctx, gain=1.0, scale=1.0) < 0.0  # drawn up
    wind = AdoptedEffect("wind", dict.fromkeys((c.name for c in get("wind").coefficients), 0.0) | {"north": 1.0, "above_radii": 0.0})  # fmt: skip # noqa: E501
    assert (
        adopted_wrench([wind], ctx)[:, 0].min() > 0.0
    )  # level, nose north: air moving north pushes forward
    cg = adopted_wrench([AdoptedEffect("cg_offset", {"x": 0.01, "y": 0.01})], ctx)
    assert (
        cg[:, 4].max() < 0.0 < cg[:, 3].min()
    )  # CG ahead: nose down; to the right: right side down


def test_a_weak_fan_also_turns_the_body_less() -> None:
    vehicle = load_vehicle(Path(vehicles.__file__).with_name("quad.toml"))
    state = replace(blank_state((), 4, 4), rpm=np.full(4, 5000.0))
    weak = Context(state=state, vehicle=vehicle)
    clockwise = [fan.rotors[0].spin > 0 for fan in vehicle.fans].index(True)
    lost = get("fan_imbalance").wrench(
        weak, {"scale": -0.1, "torque": -0.1, "fan": clockwise + 1.0}
    )
    assert lost[2] > 0.0  # less lift
    assert lost[5] > 0.0  # a clockwise rotor turned the body counter-clockwise


def at_the_wall(ctx: Context, d_m: float, pitch_rad: float = 0.0) -> Context:
    """The wall ahead at ``d_m``, the vehicle not turning."""
    sine, cosine = np.sin(pitch_rad), np.cos(pitch_rad)
    pitched = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    rows = len(ctx.state)
    state = replace(
        ctx.state,
        d_m=np.full_like(ctx.state.d_m, d_m),
        wall_bearing_rad=np.zeros(rows),
        rates=np.zeros((rows, 3)),
        rotation=np.broadcast_to(pitched, (rows, 3, 3)),
    )
    return Context(state=state, vehicle=ctx.vehicle, model=ctx.model)


def bumper(ctx: Context, damping_s: float = 0.1) -> Array:
    """Wrench (n, 6) of a bumper of 100 N/m with a reach of 7 cm."""
    touch = AdoptedEffect("contact", {"stiffness": 100.0, "reach_m": 0.07, "damping_s": damping_s})
    return adopted_wrench([touch], ctx)


def test_a_bumper_pushes_back_harder_while_it_closes_and_never_pulls(ctx: Context) -> None:
    near = at_the_wall(ctx, 0.05)
    closing = near.velocity[:, 0]
    assert closing.min() < -0.2 < 0.0 < closing.max()
    pressed = np.maximum(0.02 + 0.1 * closing, 0.0)
    fans = len(ctx.vehicle.fans)
    assert bumper(near)[:, 0] == pytest.approx(-fans * 100.0 * pressed, abs=1e-9)
    assert not bumper(at_the_wall(ctx, 0.08)).any()


def test_a_bumper_pushes_a_leaning_vehicle_along_the_walls_normal(ctx: Context) -> None:
    wrench = bumper(at_the_wall(ctx, 0.05, pitch_rad=-0.2), damping_s=0.0)[0]
    push = 2.0 * len(ctx.vehicle.fans)
    # Nose down, the belly faces back: the push from ahead also presses the vehicle down its axis.
    assert wrench[:3] == pytest.approx([-push * np.cos(0.2), 0.0, -push * np.sin(-0.2)])


def test_an_impact_is_as_smooth_as_it_was_measured(ctx: Context) -> None:
    time_s = np.arange(200) * 0.02
    vehicle = default_vehicle()
    fans = len(vehicle.fans)
    rows = blank_state((200,), fans, len(vehicle.rotors))
    struck = replace(
        rows,
        time_s=time_s,
        d_m=np.where(time_s[:, None] < 2.0, 0.10, 0.05) * np.ones(fans),
        wall_bearing_rad=np.zeros(200),
        rates=np.zeros((200, 3)),
        velocity_ned=np.zeros((200, 3)),
        rotation=np.broadcast_to(np.eye(3), (200, 3, 3)),
    )
    sharp = Context(state=struck, vehicle=vehicle)
    soft = replace(sharp, smoothed_s=0.1)
    sharp_n, soft_n = bumper(sharp)[:, 0], bumper(soft)[:, 0]
    assert soft_n[time_s < 1.5] == pytest.approx(0.0, abs=1e-6)
    assert soft_n[100] == pytest.approx(sharp_n[100] / 2.0, rel=0.1)
    assert soft_n[160] == pytest.approx(sharp_n[160], rel=1e-3)


def test_a_hanging_load_pulls_down_and_at_its_hook(ctx: Context) -> None:
    roll = 0.1
    tilted = np.array(
        [[1.0, 0.0, 0.0], [0.0, np.cos(roll), -np.sin(roll)], [0.0, np.sin(roll), np.cos(roll)]]
    )
    state = replace(ctx.state.take(0), rotation=tilted)
    load = AdoptedEffect("slung_load", {"swinging": 0.0, "mass": 0.2, "hook": 0.02, "rope_m": 0.5})
    wrench = adopted_wrench([load], Context(state=state, vehicle=ctx.vehicle, model=ctx.model))
    pull = float(np.linalg.norm(wrench[:3]))
    assert wrench[:3] == pytest.approx(pull * tilted[2])  # along down, not along the body
    assert wrench[3] == pytest.approx(-0.1 * wrench[1])  # 0.1 m below the CG: it rights the body


def test_an_effect_says_itself_what_it_corrects(
    ctx: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = replace(
        get("range_offset"),
        name="slow_clock",
        in_flight=FlightUse(
            corrected=lambda state, p: replace(state, time_s=state.time_s + p["offset_m"])
        ),
    )
    monkeypatch.setattr("models.effects.catalogue", lambda: (slow,))
    late = corrected_state([AdoptedEffect("slow_clock", {"offset_m": 0.5})], ctx.state)
    np.testing.assert_allclose(late.time_s, ctx.state.time_s + 0.5)


def test_a_range_offset_corrects_the_heights(ctx: Context) -> None:
    moved = corrected_state(
        [AdoptedEffect("range_offset", {"offset_m": 0.05, "secant_m": 0.045})], ctx.state
    )
    assert np.allclose(moved.h_m, ctx.state.h_m - 0.05)


def test_a_corrected_measurement_is_not_corrected_twice(ctx: Context) -> None:
    offset = [AdoptedEffect("range_offset", {"offset_m": 0.05, "secant_m": 0.05})]
    assert np.all(adopted_wrench(offset, ctx) == 0.0)


def test_drag_areas_are_measured_in_discs(ctx: Context) -> None:
    drag = [AdoptedEffect("body_drag", {"front": 1.0, "side": 1.0, "top": 0.0})]
    wrench = adopted_wrench(drag, ctx)
    large = replace(ctx.vehicle, rotor_radius_m=2.0 * ctx.vehicle.rotor_radius_m)
    assert adopted_wrench(drag, replace(ctx, vehicle=large)) == pytest.approx(4.0 * wrench)


def test_drag_of_a_body_that_is_alike_on_all_sides_is_against_its_motion(ctx: Context) -> None:
    """Pressure drag goes with |v| v: in a slanted flight its parts are not those of flights along each axis."""
    drag = [AdoptedEffect("body_drag", {"front": 1.0, "side": 1.0, "top": 1.0})]
    level = np.broadcast_to(np.eye(3), ctx.state.rotation.shape)
    slanted = np.broadcast_to([3.0, 4.0, 0.0], ctx.state.velocity_ned.shape)
    straight = np.broadcast_to([5.0, 0.0, 0.0], ctx.state.velocity_ned.shape)
    state = replace(ctx.state, rotation=level, velocity_ned=slanted)
    ahead = replace(ctx.state, rotation=level, velocity_ned=straight)
    force = adopted_wrench(drag, replace(ctx, state=state))[..., :3]
    size = np.linalg.norm(adopted_wrench(drag, replace(ctx, state=ahead))[..., :3], axis=-1)
    assert force[..., :2] == pytest.approx(-size[..., None] * np.array([0.6, 0.8]))


def test_what_is_not_measured_adds_nothing(ctx: Context) -> None:
    dark = Context(
        state=replace(ctx.state, ceiling_m=np.full_like(ctx.state.ceiling_m, np.nan)),
        vehicle=ctx.vehicle,
        model=ctx.model,
    )
    assert fz("ceiling", dark, gain=1.0, scale=1.0) == 0.0


def moments(name: str, ctx: Context, **parameters: float) -> Array:
    return get(name).wrench(ctx, parameters)[0, 3:]


def test_a_trim_is_the_same_moment_whatever_the_rotors_do(ctx: Context) -> None:
    trim = get("trim_moment").wrench(ctx, {"roll": 0.1, "pitch": -0.2, "yaw": 0.3})
    assert trim[:, :3] == pytest.approx(0.0)
    assert trim[:, 3:] == pytest.approx(np.tile([0.1, -0.2, 0.3], (len(trim), 1)))


def test_turning_is_held_back(ctx: Context) -> None:
    rates = np.broadcast_to([1.0, -2.0, 3.0], ctx.state.rates.shape)
    turning = replace(ctx, state=replace(ctx.state, rates=rates))
    unit = ctx.lever**2 * ctx.mass_flow[0].sum()
    held = moments("rate_damping", turning, tilting=0.5, yaw=0.1)
    assert held == pytest.approx(unit * np.array([-0.5, 1.0, -0.3]))


def test_rotors_that_speed_up_turn_the_vehicle_back() -> None:
    """By the angular momentum that they take: J times the change of their spin, whatever the rates are."""
    vehicle = load_vehicle(Path(vehicles.__file__).with_name("quad.toml"))
    spins = np.array([rotor.spin for rotor in vehicle.rotors])
    time_s = np.arange(5.0)
    rpm = 5000.0 + 60.0 * np.outer(time_s, spins > 0)
    rates = np.ones((5, 3))
    state = replace(blank_state((5,), 4, 4), time_s=time_s, rpm=rpm, rates=rates)
    spun = Context(state=state, vehicle=vehicle)
    wrench = get("rotor_inertia").wrench(spun, {"inertia": 1e-4})
    change = 2 * 60.0 * np.pi / 30.0
    assert wrench[:, 5] == pytest.approx(-1e-4 * change)
    assert wrench[:, :5] == pytest.approx(0.0)
    flywheel = get("gyroscopic").wrench(spun, {"inertia": 1e-4, "all_alike": 0.0})
    assert flywheel[:, 5] == pytest.approx(wrench[:, 5])


def test_airflow_from_ahead_lifts_the_nose(ctx: Context) -> None:
    level = np.broadcast_to(np.eye(3), ctx.state.rotation.shape)
    ahead = np.broadcast_to([2.0, 0.0, 0.0], ctx.state.velocity_ned.shape)
    left = np.broadcast_to([0.0, -2.0, 0.0], ctx.state.velocity_ned.shape)
    one = replace(ctx, state=replace(ctx.state, rotation=level, velocity_ned=ahead))
    other = replace(ctx, state=replace(ctx.state, rotation=level, velocity_ned=left))
    roll, pitch, yaw = moments("flapping_moment", one, moment=1.0)
    assert pitch > 0.0
    assert (roll, yaw) == (0.0, 0.0)
    roll, pitch, yaw = moments("flapping_moment", other, moment=1.0)
    assert roll > 0.0
    assert (pitch, yaw) == (0.0, 0.0)


def test_a_lever_that_no_hub_has_is_said_to_be_the_moment_of_the_airflow(ctx: Context) -> None:
    drag = get("rotor_drag")
    alone = {"drag": 0.4, "turning": 0.0, "sinking": 0.0}
    high, hub = (alone | {"above_radii": above} for above in (1.6, 1.0))
    flapping = get("flapping_moment").wrench(ctx, {"moment": 0.24})
    assert drag.wrench(ctx, high) == pytest.approx(drag.wrench(ctx, hub) + flapping)
    assert drag.shown.in_words is not None
    assert "flapping_moment of 0.24" in drag.shown.in_words(ctx, high)
    assert "flapping" not in drag.shown.in_words(ctx, hub)


@pytest.mark.parametrize(
    ("level", "climb"), [(0.0, 0.0), (2.5, 0.0), (15.0, 3.0), (0.0, 5.0), (4.0, -2.0)]
)
def test_induced_velocity_is_that_of_momentum_theory(level: float, climb: float) -> None:
    """Thrust is the mass flow through the disc times what the fan adds."""
    hover = np.array([5.0])
    v = induced(hover, level, climb)
    assert v * np.hypot(level, climb + v) == pytest.approx(hover**2, rel=1e-3)


def test_a_fan_in_its_own_wake_has_a_finite_induced_velocity() -> None:
    assert 5.0 < induced(np.array([5.0]), 0.0, -20.0)[0] < 10.0


def test_a_fan_lifts_more_at_speed(ctx: Context) -> None:
    level = np.broadcast_to(np.eye(3), ctx.state.rotation.shape)
    fast = np.broadcast_to([12.0, 0.0, 0.0], ctx.state.velocity_ned.shape)
    moving = replace(ctx, state=replace(ctx.state, rotation=level, velocity_ned=fast))
    assert fz("momentum_thrust", moving, slope=4.0) < 0.0


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(ModelError, match="not in the catalogue"):
        get("phlogiston")


def test_a_model_directory_may_lack_an_optional_parameter() -> None:
    known = {"power": 2.0, "at_reference": 0.0, "reference_v": 16.0}
    assert adopted("battery_sag", known).parameters == known | {"ohmic": 0.0}
    pulled = {"pull": 0.1, "tilt": 0.1, "length_radii": 1.0}
    assert adopted("wall_effect", pulled).parameters == pulled | {"lift": 0.0}
    still_air = {"turning": 0.0, "north": 0.0, "east": 0.0, "level": 0.0}
    assert adopted("vertical_inflow", {"slope": 4.0}).parameters == {"slope": 4.0} | still_air
    with pytest.raises(ModelError, match="lacks parameter 'power'"):
        adopted("battery_sag", {"at_reference": 0.0, "reference_v": 16.0})


def test_a_load_is_what_a_vehicle_can_lift_and_what_can_be_missing(ctx: Context) -> None:
    outputs = replace(
        ctx,
        vehicle=replace(
            ctx.vehicle,
            throttle=Throttle(
                max_thrust_n=40.0, expo=0.6, pwm_min_us=1000.0, pwm_max_us=2000.0, voltage_v=16.0
            ),
        ),
    )
    (mass,) = get("payload").coefficients
    kg = ctx.vehicle.mass_kg
    assert -0.3 * kg < mass.least(ctx) < -0.2 * kg
    lifted = 40.0 * len(ctx.vehicle.rotors) / 9.80665
    assert mass.most(outputs) == pytest.approx(max(lifted - kg, 0.2 * kg))
    for coefficient in get("slung_load").coefficients[:2]:
        assert coefficient.most(outputs) == mass.most(outputs)


def test_a_load_is_said_by_its_own_mass(ctx: Context) -> None:
    """A quarter of the mass more takes a fifth off the acceleration that the same lift gives."""
    kg = ctx.vehicle.mass_kg
    lift = ctx.thrust.sum(axis=-1)
    felt = lift / (1.25 * kg)
    parameters = {"mass": 0.2 * kg}
    missing = get("payload").wrench(ctx, parameters)[..., 2]
    assert missing == pytest.approx(lift - kg * felt)
    assert get("payload").said(ctx, parameters)["mass_kg"] == pytest.approx(0.25 * kg)


def test_a_swing_takes_a_flight_that_outlasts_it(ctx: Context) -> None:
    """Of a swing of a metre the beginning is forgotten after eight seconds, of one of two metres after eleven."""
    hop, flight, long = (replace(ctx, judged_s=(0.0, seconds)) for seconds in (7.0, 17.0, 60.0))
    slung = get("slung_load")
    assert "too short" in str(slung.lacking(hop))
    assert max(rope for (rope,) in slung.shape_grid(flight)) <= 1.2
    assert max(rope for (rope,) in slung.shape_grid(long)) == 2.0


def test_thrust_that_follows_the_voltage_does_so_with_a_power_of_one_to_two(ctx: Context) -> None:
    power = get("battery_sag").coefficients[0]
    assert 1.0 <= power.mean(ctx) <= 2.0
    assert power.mean(ctx) - 2.0 * power.spread(ctx) > 0.0


def test_thrust_that_only_answers_disturbances_shows_no_current(ctx: Context) -> None:
    """A loop that answers a loss of lift by more thrust looks like thrust that falls with the current."""
    (ohmic,) = (c for c in get("battery_sag").coefficients if c.name == "ohmic")
    outputs = replace(
        ctx,
        vehicle=replace(
            ctx.vehicle,
            throttle=Throttle(
                max_thrust_n=40.0, expo=0.6, pwm_min_us=1000.0, pwm_max_us=2000.0, voltage_v=16.0
            ),
        ),
    )
    assert ohmic.spread(outputs) == 0.1
    assert ohmic.spread(replace(outputs, commanded=0.0)) < 0.01


def test_outdoors_some_wind_is_the_rule(ctx: Context) -> None:
    wind = get("wind")
    assert wind.search.log_odds(ctx) < -2.0
    assert wind.search.log_odds(replace(ctx, open_sky=True)) > 1.0


def test_vanes_in_the_stream_of_a_weak_fan_are_weak_too(ctx: Context) -> None:
    servo = np.full_like(ctx.state.servo_us, 1500.0)
    vane = ctx.vehicle.vanes[0]
    servo[..., vane.servo - 1] = 1700.0
    deflected = Context(
        state=replace(ctx.state, servo_us=servo), vehicle=ctx.vehicle, model=ctx.model
    )
    neutral = Context(
        state=replace(ctx.state, servo_us=np.full_like(servo, 1500.0)),
        vehicle=ctx.vehicle,
        model=ctx.model,
    )
    weak = {"scale": -0.1, "torque": 0.0, "fan": float(vane.fan)}
    change = get("fan_imbalance").wrench(deflected, weak) - get("fan_imbalance").wrench(
        neutral, weak
    )
    side = (
        0.1
        * vane.force_per_thrust_rad
        * vane.rad_per_us
        * 200.0
        * deflected.shared_thrust[:, vane.fan - 1]
    )
    assert change[:, :3] == pytest.approx(-side[:, None] * np.asarray(vane.axis))


def test_scales_of_thrust_in_a_record_do_not_follow_the_difference_between_fans(
    ctx: Context,
) -> None:
    nodding = ctx.state.rpm.copy()
    nodding[:, : nodding.shape[1] // 2] *= 1.0 + 0.02 * np.sin(np.arange(len(nodding)))[:, None]
    record = Context(state=replace(ctx.state, rpm=nodding), vehicle=ctx.vehicle, model=ctx.model)
    assert record.shared_thrust.sum(axis=1) == pytest.approx(record.thrust.sum(axis=1))
    share = record.shared_thrust / record.shared_thrust.sum(axis=1, keepdims=True)
    assert np.ptp(share, axis=0).max() < 1e-12
    instant = Context(state=record.state.take(3), vehicle=ctx.vehicle, model=ctx.model)
    assert instant.shared_thrust == pytest.approx(instant.thrust)
