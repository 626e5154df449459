"""The residual of flight is that of diagnosis: the same formulas on one instant."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import models
from companion.adaptation import sizes as at
from companion.adaptation.block import IMU_LAG_S, Block, add, begin, follow, measured
from companion.adaptation.residual import block_residual
from companion.adaptation.vanes import vane_outputs, vanes_wrench
from companion.disturbance.about_cg import about_cg
from companion.disturbance.records import FanPlaces, Parts
from companion.mavlink.samples import Imu
from companion.vehicles import default_vehicle
from models.air_state import blank_state
from models.common.frames import measured_wrench, quaternion_from_euler, rotation_from_quaternion
from models.effects import Context, get
from models.vehicle import Vehicle, load_vehicle
from models.vehicle_wrench import RPM_TO_RAD_S, modelled_wrench, vane_wrench

RNG = np.random.default_rng(11)
TANDEM = default_vehicle()
QUAD = load_vehicle(models.__file__.replace("models/__init__.py", "companion/vehicles/quad.toml"))
SIZES = at.FIRST_EFFECT


def parts_at(
    vehicle: Vehicle, model: object, h: np.ndarray, d: np.ndarray, rpm: np.ndarray, bearing: float
) -> Parts:
    near = model.query(h, d, rpm).wrench  # type: ignore[attr-defined]
    free = model.query(np.full_like(h, np.inf), np.full_like(d, np.inf), rpm).wrench  # type: ignore[attr-defined]
    radius = vehicle.rotor_radius_m
    around = FanPlaces(tuple(h / radius), tuple(d / radius), tuple(free[:, 2]), bearing)
    return Parts(
        np.array([near, free]),
        np.zeros((0, 6)),
        float(rpm.mean()) * RPM_TO_RAD_S * radius,
        float(-near[:, 2].sum()),
        around,
    )


def block_of(parts: Parts, velocity: np.ndarray, vanes: tuple[float, ...] = ()) -> Block:
    """A block with one sample."""
    force, rates = RNG.normal(size=3), RNG.normal(size=3)
    return Block(
        0.0, 0.2, (*force, *(rates + 0.1)), tuple(rates - 0.1), 1, (*force, *rates, *velocity), vanes, parts.at_fans,
        parts.effects, parts.tip_m_s,
    )  # fmt: skip


def moment() -> tuple[Parts, np.ndarray, np.ndarray, Block, Context]:
    """A random instant of the tandem beside a wall, in both forms."""
    model, bearing = models.load(), float(RNG.uniform(-1, 1))
    h, d, rpm = RNG.uniform(0.2, 0.5, 2), RNG.uniform(0.1, 0.4, 2), RNG.uniform(3700, 4300, 2)
    rotation = rotation_from_quaternion(
        quaternion_from_euler(*RNG.uniform(-0.2, 0.2, 2), RNG.uniform(-3, 3))
    )
    velocity, servo = RNG.normal(size=3), np.full(16, np.nan)
    servo[4:6] = RNG.uniform(1400, 1600, 2)
    parts = parts_at(TANDEM, model, h, d, rpm, bearing)
    block = block_of(parts, velocity, vane_outputs(TANDEM, tuple(servo)))
    state = replace(
        blank_state((), 2, 4), h_m=h, d_m=d, rpm=np.repeat(rpm, 2), wall_bearing_rad=np.asarray(bearing),
        rotation=rotation, velocity_ned=velocity, servo_us=servo,
    )  # fmt: skip
    return parts, rotation, velocity, block, Context(state=state, vehicle=TANDEM, model=model)


def bearing_of(ctx: Context) -> float:
    return float(ctx.state.wall_bearing_rad)


def test_modelled_and_measured_are_those_of_diagnosis():
    for _ in range(5):
        _, rotation, _, block, ctx = moment()
        seen = block_residual(block, TANDEM, rotation, bearing_of(ctx), SIZES)
        assert np.allclose(
            seen.modelled, modelled_wrench(TANDEM, ctx.model, ctx.state)[:5], atol=1e-9
        )  # type: ignore[arg-type]
        told = measured_wrench(
            block.motion[:3],
            block.motion[3:6],
            np.full(3, 1.0),
            TANDEM.mass_kg,
            TANDEM.inertia_kgm2,
        )  # the rates of the block rise by 0.2 in 0.2 s
        assert np.allclose(seen.residual + seen.modelled, told[:5], atol=1e-9)


def test_vanes_are_those_of_diagnosis():
    servo = np.full(16, np.nan)
    servo[4:6] = (1432.0, 1588.0)
    ours = vanes_wrench(TANDEM, vane_outputs(TANDEM, tuple(servo)), [20.0, 24.0])
    assert np.allclose(ours, vane_wrench(TANDEM, servo, np.array([20.0, 24.0])), atol=1e-12)


def test_a_vane_that_is_not_told_hides_only_the_axes_it_acts_on():
    ours = np.array(vanes_wrench(TANDEM, [1550.0, math.nan], [20.0, 24.0]))
    assert np.isfinite(ours[[0, 2, 4]]).all()
    assert np.isnan(ours[[1, 3]]).all()


@pytest.mark.parametrize(
    ("column", "effect", "shape", "place"),
    [
        (at.THRUST, "thrust_scale", (), 0), (at.CG_X, "cg_offset", (), 0), (at.CG_Y, "cg_offset", (), 1),
        (at.NORTH, "wind", (0.0,), 0), (at.EAST, "wind", (0.0,), 1), (at.DRAG, "rotor_drag", (0.0,), 0),
        (at.INFLOW, "vertical_inflow", (), 0),
    ],
)  # fmt: skip
def test_every_common_size_acts_as_the_catalogue_says(column, effect, shape, place):
    _, rotation, _, block, ctx = moment()
    # Beside a wall a modelled lift differs from the declared one, by which the catalogue goes.
    free = models.load().query(np.full(2, np.inf), np.full(2, np.inf), ctx.rpm).wrench[:, 2]
    assert np.allclose(ctx.thrust, free)
    ours = block_residual(block, TANDEM, rotation, bearing_of(ctx), SIZES).regressors[:, column]
    theirs = get(effect).regressors(ctx, shape)[:5, place]
    assert ours == pytest.approx(theirs, rel=0.02, abs=0.02 * np.abs(theirs).max() + 1e-9)


def test_drag_above_is_the_arm_of_the_drag():
    _, rotation, _, block, ctx = moment()
    rows = block_residual(block, TANDEM, rotation, bearing_of(ctx), SIZES).regressors
    at_half = get("rotor_drag").regressors(ctx, (0.5,))[:5, 0]
    assert rows[:, at.DRAG] + 0.5 * rows[:, at.DRAG_ARM] == pytest.approx(
        at_half, rel=0.02, abs=1e-3
    )


def test_the_parts_add_up_to_the_whole():
    parts, _, _, _, ctx = moment()
    whole = modelled_wrench(TANDEM, ctx.model, replace(ctx.state, servo_us=np.full(16, 1500.0)))  # type: ignore[arg-type]
    near, free = parts.at_fans
    rows = about_cg(TANDEM, (near - free).tolist(), bearing_of(ctx))
    assert np.allclose(
        np.sum([*rows, *about_cg(TANDEM, free.tolist(), bearing_of(ctx))], axis=0), whole, atol=1e-9
    )
    lift, pull, tilt = np.array(rows)
    assert lift[0] == lift[1] == 0.0
    assert pull[2] == 0.0
    assert not tilt[:3].any()


@pytest.mark.parametrize("apart", [0.0, 30.0])
def test_a_quadrotors_moments_are_seen_unless_its_outputs_are_copies_of_one_number(apart):
    model, rpm = models.load(), 5000.0 + apart * np.array([1.0, -1.0, 0.5, -0.7])
    parts = parts_at(QUAD, model, np.full(4, 0.3), np.full(4, 0.4), rpm, 0.3)
    seen = block_residual(block_of(parts, np.zeros(3)), QUAD, np.eye(3), 0.3, SIZES)
    assert np.isfinite(seen.residual[:3]).all()
    assert np.isfinite(seen.residual[3:]).all() == (apart > 0.0)


def imu(
    t: float, f: tuple[float, float, float], w: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Imu:
    return Imu(t, 1, 1, f, w, "HIGHRES_IMU")


def test_the_lag_delays_a_ramp_by_what_it_says():
    parts = Parts(
        np.zeros((2, 2, 6)),
        np.zeros((0, 6)),
        70.0,
        0.0,
        FanPlaces((9.0,) * 2, (9.0,) * 2, (20.0,) * 2),
    )
    block = begin(imu(0.0, (0.0, 0.0, 0.0)))
    for k in range(1, 101):
        block = add(block, imu(0.02 * k, (0.02 * k, 0.0, 0.0)), parts, (0.0, 0.0, 0.0), ())
    assert 2.0 - block.lagged[0] == pytest.approx(IMU_LAG_S, rel=1e-6)
    after = follow(block)
    assert after.lagged == block.lagged
    assert after.samples == 0
    assert measured(block, TANDEM)[0] == pytest.approx(4.6 * (1.01 - IMU_LAG_S), abs=0.02)
