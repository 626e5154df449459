"""The decisions of the pipeline of flight as columns, beside what a log holds."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from companion.adaptation import begin
from companion.adaptation.adaptation import Adaptation
from companion.config import PipelineConfig
from companion.control.compensation import Offset
from companion.control.position_hold import BaseSetpoint
from companion.disturbance.records import Disturbance
from companion.estimation.surfaces import Seen, Surface
from companion.state.decision import Decision
from models.common.frames import Array
from replay.export.columns import Column
from replay.rerun.report import play
from replay.spill import BLOCK, Spool, picked

_NOTHING = "none"
_ABSENT = Surface(Seen.UNDECLARED)
_NO_BASE = BaseSetpoint(*(math.nan,) * 4)


class Quantity(NamedTuple):
    """One number, or text, of a decision."""

    name: str
    unit: str
    description: str
    value: float | str


def _decided(d: Decision) -> Iterator[Quantity]:
    offset = d.offset
    base = d.base or _NO_BASE
    seen = "as applied, after limits and fade"
    yield Quantity(
        "offset_thrust", "1", f"offset of thrust, share of full throttle, {seen}", offset.thrust
    )
    yield Quantity("offset_roll_rad", "rad", f"offset of roll, {seen}", offset.roll)
    yield Quantity("offset_pitch_rad", "rad", f"offset of pitch, {seen}", offset.pitch)
    yield Quantity(
        "offset_share",
        "1",
        "share of the modelled disturbance that the offset cancels",
        offset.share,
    )
    yield Quantity("authority", "1", "fade of the offsets, 0 to 1", d.authority)
    yield Quantity(
        "late_s", "s", "how late the attitude or position behind the decision arrived", d.late_s
    )
    yield Quantity("base_thrust", "1", "thrust before the offset", base.thrust)
    for axis in ("roll", "pitch", "yaw"):
        yield Quantity(f"base_{axis}_rad", "rad", f"{axis} before the offset", getattr(base, axis))
    refusals = "; ".join(reason.value for reason in d.reasons) or _NOTHING
    yield Quantity(
        "refusals", "1", f"why offsets are held back; {_NOTHING} where nothing does", refusals
    )


def _modelled(seen: Disturbance | None) -> Iterator[Quantity]:
    if seen is None:
        seen = Disturbance(
            wrench=(math.nan,) * 6,
            free_lift_n=math.nan,
            trust=math.nan,
            gain=math.nan,
            h_m=(math.nan,),
            d_m=(math.nan,),
            ground=_ABSENT,
            wall=_ABSENT,
            ceiling=_ABSENT,
        )
    for name, value in zip(("fx", "fy", "fz", "mx", "my", "mz"), seen.wrench, strict=True):
        unit, tail = ("N", "n") if name[0] == "f" else ("N m", "n_m")
        yield Quantity(
            f"model_{name}_{tail}", unit, "modelled disturbance, body FRD about the CG", value
        )
    yield Quantity("model_free_lift_n", "N", "modelled lift in free air", seen.free_lift_n)
    yield Quantity("model_trust", "1", "how far the model is believed", seen.trust)
    yield Quantity("model_gain", "1", "gain of the feed-forward, bounded towards a wall", seen.gain)
    yield Quantity(
        "used_h_m",
        "m",
        "height over ground of the lowest fan, as the model was asked",
        min(seen.h_m),
    )
    yield Quantity(
        "used_d_m", "m", "wall distance of the nearest fan, as the model was asked", min(seen.d_m)
    )
    for name, surface in (("ground", seen.ground), ("wall", seen.wall), ("ceiling", seen.ceiling)):
        if math.isfinite(surface.distance_m):
            sd = surface.sigma_m
        else:
            sd = math.nan
        yield Quantity(
            f"{name}_distance_m",
            "m",
            f"filtered distance of the CG to the {name}",
            surface.distance_m,
        )
        yield Quantity(f"{name}_distance_sd_m", "m", f"standard deviation of {name}_distance_m", sd)


def _measured(known: Adaptation) -> Iterator[Quantity]:
    for name, e in known.estimates().items():
        yield Quantity(f"size_{name}", e.unit, "size of an effect, as measured so far", e.value)
        yield Quantity(f"size_{name}_sd", e.unit, f"standard deviation of size_{name}", e.sd)
    for name, share in known.share_by_name().items():
        yield Quantity(
            f"compensated_{name}", "1", "share of the model's wrench that is compensated", share
        )


def _told(d: Decision, before: Decision | None) -> Iterator[tuple[str, Iterator[Quantity]]]:
    """Topics, and what is said in them where it is not as ``before``."""
    yield "decision", _decided(d)
    if before is None or d.disturbance is not before.disturbance:
        yield "model", _modelled(d.disturbance)
    known = d.adaptation
    last = before and before.adaptation
    if known is not None and (last is None or known.sizes is not last.sizes):
        yield "sizes", _measured(known)


class _Topic:
    """What is said in one topic, row by row: times [s], and the values of every quantity."""

    def __init__(self, quantities: list[Quantity]) -> None:
        self.quantities = quantities
        self.last_s = -math.inf
        self._rows = [array("d") for _ in range(1 + len(quantities))]
        self._stored = [Spool(np.float64) for _ in self._rows]

    def add(self, t_s: float, values: Iterable[float]) -> None:
        """A row; ``values`` of all quantities."""
        self.last_s = t_s
        for column, value in zip(self._rows, (t_s, *values), strict=True):
            column.append(value)
        if len(self._rows[0]) >= BLOCK:
            self._store()

    def columns(self) -> list[Array]:
        """Times (n,), and the values (n,) of each quantity."""
        self._store()
        return [spool.array() for spool in self._stored]

    def _store(self) -> None:
        for column, spool in zip(self._rows, self._stored, strict=True):
            spool.append(np.array(column))
            del column[:]


class Decisions:
    """The decisions on one boot. Values that are no number are left out of the columns."""

    def __init__(self, config: PipelineConfig) -> None:
        self._before: Decision | None = None
        self._words: dict[str, int] = {}
        self._topics: dict[str, _Topic] = {}
        nothing = Decision(
            t_s=0.0,
            command=None,
            reasons=(),
            authority=0.0,
            offset=Offset(),
            base=None,
            disturbance=None,
            adaptation=begin.initial(config),
        )
        for topic, said in _told(nothing, None):
            self._topics[topic] = _Topic(list(said))

    def add(self, d: Decision) -> None:
        """Take in the next one; of several at one time the first counts."""
        for name, said in _told(d, self._before):
            topic = self._topics[name]
            if topic.last_s >= d.t_s:
                continue
            row = {q.name: q.value for q in said}
            topic.add(d.t_s, [self._number(row.get(q.name, math.nan)) for q in topic.quantities])
        self._before = d

    def _number(self, value: float | str) -> float:
        """A number as it is; a text as its place among the texts."""
        if isinstance(value, str):
            return self._words.setdefault(value, len(self._words))
        return value

    def columns(self) -> Iterator[Column]:
        """Every column, also those without a sample."""
        for name, topic in self._topics.items():
            t_s, *columns = topic.columns()
            for q, values in zip(topic.quantities, columns, strict=True):
                known = np.isfinite(values)
                if isinstance(q.value, str):
                    words = tuple(self._words)
                else:
                    words = None
                yield Column(
                    name=q.name,
                    unit=q.unit,
                    description=q.description,
                    t_s=t_s if known.all() else picked(t_s, known),
                    values=values if known.all() else picked(values, known),
                    topic=name,
                    words=words,
                )


def decide(
    path: Path,
    config: PipelineConfig,
    target: int | None,
    assumed: Mapping[str, float],
    *,
    quiet: bool,
) -> dict[int, Decisions]:
    """The decisions on a log, by boot."""
    played = play(path, config, target, assumed, quiet=quiet)
    out: dict[int, Decisions] = {}
    for decision in played.decisions:
        boot = played.boots() - 1
        if boot not in out:
            out[boot] = Decisions(config)
        out[boot].add(decision)
    return out
