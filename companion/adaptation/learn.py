"""A full block into sizes and channels."""

from __future__ import annotations

import math
from collections.abc import Sequence

from companion.adaptation import judge
from companion.adaptation import residual as residual_of
from companion.adaptation.adaptation import Adaptation
from companion.adaptation.apply import towards
from companion.adaptation.beliefs import believed_of, learned_of, wanted_of
from companion.adaptation.block import AXES, BLOCK_S
from companion.adaptation.block_noise import scatter
from companion.adaptation.channel import place_of
from companion.adaptation.channel import rows as state_rows
from companion.adaptation.filter import Flags, excites, inflate, predict, surprises, update
from companion.adaptation.near_map import GAPS, HEIGHTS
from companion.adaptation.sizes import (
    EAST,
    FIRST_EFFECT,
    GAINS,
    LIFT,
    NORTH,
    PULL,
    THRUST,
    TILT,
    Size,
    Sizes,
)
from companion.config import PipelineConfig
from companion.disturbance.records import THRUST_LEAD_S, Disturbance, FanPlaces
from models.common.frames import Array
from models.common.frozen_copy import with_changes

_LAG_DOUBT_S = 0.03
"""What may be left of the accelerometer's lag: a modelled wrench that changes quickly is trusted less."""
_ALIKE = 2.0
"""Variance of a block's noise over that of its differences: errors of neighbours are alike. Chosen such that the 90 %
intervals of simulated flights cover (docs/lab/adaptation.md)."""
_ALIKE_NEAR = 4.0
"""The same for the map, which is wrong by what bilinear cells cannot follow, too."""
_FREE_AIR_S = 0.5
"""Where only steady sizes are seen they are looked at so often: every third block."""


def learn(known: Adaptation, config: PipelineConfig) -> Adaptation:
    """The adaptation with its full block taken in. ``settle`` calls it: no setpoint waits for it."""
    if known.full is None:
        return known
    block, here, rotation = known.full
    assert here.parts is not None
    table = known.table
    sizes = known.sizes
    wind = (float(sizes.offset[NORTH]), float(sizes.offset[EAST]))
    seen = residual_of.block_residual(
        block, config.vehicle, rotation, here.parts.around.bearing_rad, len(table), wind
    )
    changed: Array | float
    if known.modelled is None:
        changed = 0.0
    else:
        changed = seen.modelled - known.modelled
    doubt = (_LAG_DOUBT_S / BLOCK_S * changed) ** 2
    variance = _ALIKE * known.variance + doubt
    doubtful = _ALIKE_NEAR * known.variance + doubt
    innovation = seen.residual - seen.regressors @ sizes.offset
    surprised = surprises(sizes, innovation, seen.regressors, variance, known.surprised)
    moves = excites(table, seen.regressors, variance)
    around = _in_the_middle(here, config)
    near = _near(moves, around)
    first = known.updated_s == -math.inf
    if first:
        seconds = BLOCK_S
    else:
        seconds = max(block.end_s - known.updated_s, 0.0)
    if first or any(near) or any(surprised) or seconds > _FREE_AIR_S:
        judged = _judged(
            known=known,
            seen=seen,
            variance=doubtful,
            seconds=seconds,
            around=around,
            near=near,
            config=config,
        )
        sizes = inflate(table, predict(table, sizes, seconds), surprised)
        sizes = _measured(table, sizes, seen, variance, moves)
        known = _believed(known, sizes, judged, block.end_s)
    applied = known.applied
    if applied is not known.wanted:
        applied = towards(applied, known.wanted, BLOCK_S)
    return with_changes(
        known,
        full=None,
        applied=applied,
        variance=scatter(known, innovation, config.vehicle),
        innovation=innovation,
        modelled=seen.modelled,
        surprised=surprised,
        learned_s=known.learned_s + block.end_s - block.start_s,
    )


def _believed(
    known: Adaptation, sizes: Sizes, judged: tuple[judge.Belief, ...], now_s: float
) -> Adaptation:
    """The adaptation with new sizes and beliefs, and with what follows from them."""
    known = with_changes(
        known,
        sizes=sizes,
        judged=judged,
        learned=learned_of(known, sizes),
        believed=believed_of(known.channels, judged),
        updated_s=now_s,
    )
    return with_changes(known, wanted=wanted_of(known))


def _measured(
    table: tuple[Size, ...],
    sizes: Sizes,
    seen: residual_of.BlockResidual,
    variance: Array,
    moves: Flags,
) -> Sizes:
    """The sizes with a block's residual taken in, one axis after another."""
    for axis, row, moved in zip(range(AXES), seen.regressors, moves, strict=True):
        residual = float(seen.residual[axis])
        sizes = update(table, sizes, residual, row, float(variance[axis]), moved)
    return sizes


def _near(moves: Flags, around: FanPlaces) -> tuple[bool, ...]:
    """Whether a block tells of the model's or the map's lift, pull and tilt, and of the adopted effects.

    In free air, where it tells only of what is steady, every third block is enough.
    """
    excited = [True in column for column in moves.T.tolist()]
    wall = min(around.gaps) < GAPS[-1]
    low = wall or min(around.heights) < HEIGHTS[-1]
    return (
        low or excited[LIFT],
        wall or excited[PULL],
        wall or excited[TILT],
        *excited[FIRST_EFFECT:],
    )


def _judged(
    known: Adaptation,
    seen: residual_of.BlockResidual,
    variance: Array,
    seconds: float,
    around: FanPlaces,
    near: Sequence[bool],
    config: PipelineConfig,
) -> tuple[judge.Belief, ...]:
    """With the model or without it: what one channel does in the axes of another is taken away first."""
    vehicle = config.vehicle
    place = place_of(around)
    thrust = 1.0 + float(known.sizes.offset[THRUST])
    gains = known.believed.shares
    beside = known.believed.near.rows(vehicle, around)
    effects = seen.regressors[:, FIRST_EFFECT:] @ known.sizes.offset[FIRST_EFFECT:]
    rest = (seen.residual - effects).tolist()
    noise = variance.tolist()
    regressors = seen.regressors.tolist()
    out = []
    for channel, before, here in zip(known.channels, known.judged, near, strict=False):
        waited_s = before.waited_s + seconds
        if not here and waited_s < _FREE_AIR_S and not any(before.surprised):
            out.append(before._replace(waited_s=waited_s))
            continue
        seen_in = []
        rows = state_rows(channel, regressors, place, vehicle.rotor_radius_m, thrust)
        for axis, row in zip(channel.axes, rows, strict=True):
            model = regressors[axis]
            value = rest[axis] + model[channel.own]
            for k in range(len(GAINS)):
                if k != channel.own:
                    value += model[k] - thrust * (beside[k][axis] + gains[k] * model[k])
            seen_in.append((value, row, noise[axis]))
        out.append(judge.learn(channel, before, waited_s, seen_in))
    return tuple(out)


def _in_the_middle(here: Disturbance, config: PipelineConfig) -> FanPlaces:
    """Where the fans were in the middle of a block that ends here."""
    assert here.parts is not None
    around = here.parts.around
    back = (0.5 * BLOCK_S + THRUST_LEAD_S) / config.vehicle.rotor_radius_m
    lower = here.ground.rate_m_s * back
    nearer = here.wall.rate_m_s * back
    heights = tuple([h - lower for h in around.heights])
    gaps = tuple([d - nearer for d in around.gaps])
    return FanPlaces(heights, gaps, around.free_lift_n, around.bearing_rad)
