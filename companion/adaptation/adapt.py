"""What adaptation remembers, and one sample of the accelerometer on: block, residual, filter, shares.

Pure; plain data in, plain data out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from companion.adapt_options import Adapt
from companion.adaptation import block as block_of
from companion.adaptation import judge
from companion.adaptation import residual as residual_of
from companion.adaptation.apply import MOST, Applied, share_of, towards
from companion.adaptation.channel import Channel, channels_of, place_of
from companion.adaptation.channel import rows as state_rows
from companion.adaptation.filter import Flags, excites, later, opened, surprises, update
from companion.adaptation.gates import NO_IMU, Situation, pause
from companion.adaptation.near_map import GAPS, HEIGHTS, NearField
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
    SizeEstimate,
    Sizes,
    channels,
    estimates,
    prior,
    size_table,
)
from companion.adaptation.vanes import vane_outputs
from companion.config import PipelineConfig
from companion.disturbance.records import THRUST_LEAD_S, Disturbance, FanPlaces
from companion.mavlink.samples import Imu
from models.common.frames import GRAVITY, Array, Rows
from models.common.frozen_copy import with_changes
from models.vehicle import Vehicle

BLOCK_S = 0.2
"""Measured and modelled wrench are averaged over this: the one filter that both go through."""
_LEAST_SAMPLES = 4
"""Of the accelerometer in a block: 20 Hz, as diagnosis asks for moments."""
_IMU_GAP_S = 0.1
"""A longer silence of the accelerometer starts a new block."""
_LAG_DOUBT_S = 0.03
"""What may be left of the accelerometer's lag: a modelled wrench that changes quickly is trusted less."""
_ALIKE = 2.0
"""Variance of a block's noise over that of its differences: errors of neighbours are alike. Chosen such that the 90 %
intervals of simulated flights cover (docs/lab/adaptation.md)."""
_ALIKE_NEAR = 4.0
"""The same for the map, which is wrong by what bilinear cells cannot follow, too."""
_NOISE_MEAN_S = 20.0
"""Over which the noise of an axis is averaged."""
_FORCE_FLOOR = 0.003
"""Least noise of a block, of the weight: a third of a centi-g of an accelerometer's drift."""
_MOMENT_FLOOR = 0.001
"""The same, of the weight times the farthest fan's arm."""
_FREE_AIR_S = 0.5
"""Where only steady sizes are seen they are looked at so often: every third block."""
_PAUSE_S = 0.6
"""After a reason not to learn has gone: what it did to the filters of ranges and rotors has gone too."""
_NOTHING = 0.05
"""A smaller share of the model is none."""
_SOURCE_SILENT_S = 1.0
_SILENT = (math.nan,) * 16
MODELS = ("lift_model", "pull_model", "tilt_model")
"""Names of the probabilities that the model is right in a channel, and not only none."""


@dataclass(frozen=True, kw_only=True)
class Adaptation:
    """All that is remembered of sizes."""

    table: tuple[Size, ...]
    sizes: Sizes
    channels: tuple[Channel, ...]
    """Lift, pull and tilt."""
    judged: tuple[judge.Belief, ...]
    """What is believed of each."""
    believed: Applied
    """Both hypotheses' mean: gains on the model's lift, pull and tilt, and what is measured beside."""
    wanted: Applied
    """What follows from it."""
    applied: Applied
    """What offsets follow: on its way to that."""
    variance: Array
    """(5,): what an axis' residual scatters by from one block to the next."""
    learned: tuple[bool, ...]
    """Whether a channel was ever excited."""
    block: block_of.Block | None = None
    full: tuple[block_of.Block, Disturbance, Rows] | None = None
    """What ``learn`` is to take in: a block, the surroundings and the rotation FRD -> NED at its end."""
    innovation: Array | None = None
    """(5,): of the newest block."""
    modelled: Array | None = None
    """(5,): of the newest block."""
    surprised: tuple[int, ...] = (0,) * block_of.AXES
    """For how many blocks in a row each axis has been far off to one side."""
    source: str = ""
    """The accelerometer that is listened to: the first that speaks."""
    heard_s: float = -math.inf
    paused: str | None = NO_IMU
    """Why nothing is learned now, as the pilot reads it."""
    paused_s: float = -math.inf
    """When a reason not to learn last held."""
    clear: Disturbance | None = None
    """The newest surroundings among which something may be learned: looked at once."""
    updated_s: float = -math.inf
    learned_s: float = 0.0
    """Time of flight that was learned from."""

    @property
    def shares(self) -> tuple[float, ...]:
        """Of the model's lift, pull, tilt and of every adopted effect with a size: what is compensated."""
        return self.applied.shares

    def estimates(self) -> dict[str, SizeEstimate]:
        """Every size by its name; then the ground's lift where no model is believed, and how far a model is."""
        out = estimates(self.table, self.sizes)
        out["cheeseman_bennett"] = SizeEstimate(
            *judge.ground_measured(self.channels[LIFT], self.judged[LIFT]), "1"
        )
        for name, judged in zip(MODELS, self.judged, strict=True):
            p = judged.probability
            out[name] = SizeEstimate(p, math.sqrt(p * (1.0 - p)), "probability")
        return out

    def share_by_name(self) -> dict[str, float]:
        """The share of the model's wrench that is compensated, by the size it follows."""
        return {
            self.table[k].name: share
            for k, share in zip(channels(self.table), self.shares, strict=True)
        }

    def as_json(self) -> dict[str, Any]:
        """``{name: {"value", "sd", "unit"}}``."""
        return {
            name: {"value": round(e.value, 4), "sd": round(e.sd, 4), "unit": e.unit}
            for name, e in self.estimates().items()
        }


def initial(config: PipelineConfig) -> Adaptation | None:
    """Before the first sample; None where nothing is to be learned."""
    if config.adapt is Adapt.OFF:
        return None
    table = size_table(config.vehicle, config.model)
    places = channels(table)
    through = channels_of(table)
    judged = tuple(judge.initial(channel) for channel in through)
    believed = _believed(through, judged)
    shares = Applied((1.0,) * len(places))
    variance = floors(config.vehicle)
    learned = (False,) * len(places)
    state = Adaptation(
        table=table,
        sizes=prior(table),
        channels=through,
        judged=judged,
        believed=believed,
        wanted=shares,
        applied=shares,
        variance=variance,
        learned=learned,
    )
    wanted = _wanted(state)
    return with_changes(state, wanted=wanted, applied=wanted)


@lru_cache(maxsize=4)
def floors(vehicle: Vehicle) -> Array:
    """Least variance of a block (5,)."""
    weight = vehicle.mass_kg * GRAVITY
    lever = max(float(np.abs(vehicle.fan_positions_m).max()), vehicle.rotor_radius_m)
    force = _FORCE_FLOOR * weight
    moment = _MOMENT_FLOOR * weight * lever
    out: Array = np.array([force, force, force, moment, moment]) ** 2
    return out


def hear(known: Adaptation, here: Situation, imu: Imu, config: PipelineConfig) -> Adaptation:
    """The adaptation one sample of an accelerometer on."""
    now_s = imu.t_s
    if imu.source != known.source:
        if now_s - known.heard_s < _SOURCE_SILENT_S:
            return known
        known = with_changes(known, source=imu.source, block=None)
    disturbance = here.disturbance
    rows = here.estimates.rows
    why = pause(here, imu, config, known.clear)
    if why is not None:
        return with_changes(
            known,
            heard_s=now_s,
            paused=why,
            paused_s=now_s,
            block=None,
            full=None,
            innovation=None,
            clear=None,
        )
    if now_s - known.paused_s < _PAUSE_S:
        return with_changes(known, heard_s=now_s)
    block = known.block
    if block is not None and now_s == block.end_s:
        return known  # sent twice
    full = known.full
    if block is None or not 0.0 < now_s - block.end_s <= _IMU_GAP_S:
        block = block_of.begin(imu)
    else:
        block = _longer(block, here, imu, config)
        if block.end_s - block.start_s >= BLOCK_S - 1e-6:
            full = None
            if block.samples >= _LEAST_SAMPLES and disturbance is not None and rows is not None:
                full = (block, disturbance, rows)
            block = block_of.follow(block)
    return with_changes(
        known, heard_s=now_s, paused=None, block=block, full=full, clear=disturbance
    )


def _longer(
    block: block_of.Block, here: Situation, imu: Imu, config: PipelineConfig
) -> block_of.Block:
    """The block with what is known at this sample."""
    disturbance = here.disturbance
    position = here.estimates.position
    servo = here.estimates.servo
    assert disturbance is not None
    assert disturbance.parts is not None
    assert position is not None
    vanes = vane_outputs(config.vehicle, _SILENT if servo is None else servo.pwm_us)
    return block_of.add(block, imu, disturbance.parts, position.velocity_ned, vanes)


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
        sizes = opened(table, later(table, sizes, seconds), surprised)
        # One axis after another.
        for axis, row, moved in zip(range(block_of.AXES), seen.regressors, moves, strict=True):
            sizes = update(
                table, sizes, float(seen.residual[axis]), row, float(variance[axis]), moved
            )
        learned = _learned(known, sizes)
        believed = _believed(known.channels, judged)
        known = with_changes(
            known,
            sizes=sizes,
            judged=judged,
            learned=learned,
            believed=believed,
            updated_s=block.end_s,
        )
        known = with_changes(known, wanted=_wanted(known))
    applied = known.applied
    if applied is not known.wanted:
        applied = towards(applied, known.wanted, BLOCK_S)
    return with_changes(
        known,
        full=None,
        applied=applied,
        variance=_scatter(known, innovation, config),
        innovation=innovation,
        modelled=seen.modelled,
        surprised=surprised,
        learned_s=known.learned_s + block.end_s - block.start_s,
    )


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


def _believed(channels: Sequence[Channel], judged: Sequence[judge.Belief]) -> Applied:
    found = [judge.believed(c, j) for c, j in zip(channels, judged, strict=True)]
    lift, pull, tilt = [tuple(cells) for _, _, cells in found]
    return Applied(
        tuple([gain for gain, _, _ in found]), NearField(found[LIFT][1], lift, pull, tilt)
    )


def _scatter(known: Adaptation, innovation: Array, config: PipelineConfig) -> Array:
    """Half the mean square of differences between neighbours (von Neumann 1941, Ann. Math. Statist. 12, 367): what a
    size is still wrong by is in both and does not count."""
    if known.innovation is None:
        return known.variance
    change = innovation - known.innovation
    fresh = 0.5 * change * change
    fresh = np.where(np.isfinite(fresh), fresh, known.variance)
    return np.maximum(
        known.variance + BLOCK_S / _NOISE_MEAN_S * (fresh - known.variance), floors(config.vehicle)
    )


def _learned(known: Adaptation, sizes: Sizes) -> tuple[bool, ...]:
    """A channel is measured once its sd is clearly less than the prior's."""
    known_of = zip(known.learned, channels(known.table), strict=True)
    return tuple([before or sizes.sd(k) < 0.9 * known.table[k].sd for before, k in known_of])


def _wanted(known: Adaptation) -> Applied:
    """What is believed. An adopted effect that never was excited stays as modelled."""
    gains = known.believed.shares
    near = known.believed.near
    shares = []
    for gain in gains:
        if gain < _NOTHING:
            shares.append(0.0)
        else:
            shares.append(min(gain, MOST))
    for k, seen in zip(
        range(FIRST_EFFECT, len(known.table)), known.learned[len(GAINS) :], strict=True
    ):
        value = known.table[k].as_modelled + float(known.sizes.offset[k])
        shares.append(share_of(value, known.sizes.sd(k)) if seen else 1.0)
    return Applied(tuple(shares), near)
