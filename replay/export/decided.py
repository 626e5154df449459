"""The decisions of the pipeline of flight as columns, beside what a log holds."""

from __future__ import annotations

import itertools
import math
from array import array
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from companion.adaptation import adapt
from companion.adaptation.adapt import Adaptation
from companion.config import PipelineConfig
from companion.control.compensation import Offset
from companion.control.position_hold import BaseSetpoint
from companion.control.state import Decision
from companion.estimation.disturbance import Disturbance
from companion.estimation.estimator import Seen, Surface
from replay.export.columns import Column
from replay.logs.formats import suffix_of
from replay.logs.pieces import Piece
from replay.rerun.report import play

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
    offset, base, seen = d.offset, d.base or _NO_BASE, "as applied, after limits and fade"
    yield Quantity("offset_thrust", "1", f"offset of thrust, share of full throttle, {seen}", offset.thrust)
    yield Quantity("offset_roll_rad", "rad", f"offset of roll, {seen}", offset.roll)
    yield Quantity("offset_pitch_rad", "rad", f"offset of pitch, {seen}", offset.pitch)
    yield Quantity("offset_share", "1", "share of the modelled disturbance that the offset cancels", offset.share)
    yield Quantity("authority", "1", "fade of the offsets, 0 to 1", d.authority)
    yield Quantity("late_s", "s", "how late the attitude or position behind the decision arrived", d.late_s)
    yield Quantity("base_thrust", "1", "thrust before the offset", base.thrust)
    for axis in ("roll", "pitch", "yaw"):
        yield Quantity(f"base_{axis}_rad", "rad", f"{axis} before the offset", getattr(base, axis))
    refusals = "; ".join(reason.value for reason in d.reasons) or _NOTHING
    yield Quantity("refusals", "1", f"why offsets are held back; {_NOTHING} where nothing does", refusals)


def _modelled(seen: Disturbance | None) -> Iterator[Quantity]:
    seen = seen or Disturbance((math.nan,) * 6, *(math.nan,) * 3, (math.nan,), (math.nan,), *(_ABSENT,) * 3)
    for name, value in zip(("fx", "fy", "fz", "mx", "my", "mz"), seen.wrench, strict=True):
        unit, tail = ("N", "n") if name[0] == "f" else ("N m", "n_m")
        yield Quantity(f"model_{name}_{tail}", unit, "modelled disturbance, body FRD about the CG", value)
    yield Quantity("model_free_lift_n", "N", "modelled lift in free air", seen.free_lift_n)
    yield Quantity("model_trust", "1", "how far the model is believed", seen.trust)
    yield Quantity("model_gain", "1", "gain of the feed-forward, bounded towards a wall", seen.gain)
    yield Quantity("used_h_m", "m", "height over ground of the lowest fan, as the model was asked", min(seen.h_m))
    yield Quantity("used_d_m", "m", "wall distance of the nearest fan, as the model was asked", min(seen.d_m))
    for name, surface in (("ground", seen.ground), ("wall", seen.wall), ("ceiling", seen.ceiling)):
        sd = surface.sigma_m if math.isfinite(surface.distance_m) else math.nan
        yield Quantity(f"{name}_distance_m", "m", f"filtered distance of the CG to the {name}", surface.distance_m)
        yield Quantity(f"{name}_distance_sd_m", "m", f"standard deviation of {name}_distance_m", sd)


def _measured(known: Adaptation) -> Iterator[Quantity]:
    for name, e in known.told().items():
        yield Quantity(f"size_{name}", e.unit, "size of an effect, as measured so far", e.value)
        yield Quantity(f"size_{name}_sd", e.unit, f"standard deviation of size_{name}", e.sd)
    for name, share in known.share_by_name().items():
        yield Quantity(f"compensated_{name}", "1", "share of the model's wrench that is compensated", share)


def _told(d: Decision, before: Decision | None) -> Iterator[tuple[str, Iterator[Quantity]]]:
    """Topics, and what is said in them where it is not as ``before``."""
    yield "decision", _decided(d)
    if before is None or d.disturbance is not before.disturbance:
        yield "model", _modelled(d.disturbance)
    known, last = d.adaptation, before and before.adaptation
    if known is not None and (last is None or known.sizes is not last.sizes):
        yield "sizes", _measured(known)


class Decided:
    """The decisions on one log, handed out with the pieces that they were made in."""

    def __init__(self, path: Path, config: PipelineConfig, assumed: Mapping[str, float]) -> None:
        self._path, self._config, self._assumed = path, config, assumed
        self.decisions = 0

        self._start()

    def _start(self) -> None:
        """As before the first decision of a boot."""
        self._before: Decision | None = None
        self._words = {_NOTHING: 0}
        self._kept: dict[str, tuple[str, Quantity, array[float], array[float]]] = {}
        nothing = Decision(0.0, None, (), 0.0, Offset(), None, None, adaptation=adapt.initial(self._config))
        for topic, quantities in _told(nothing, None):
            self._kept |= {q.name: (topic, q, array("d"), array("d")) for q in quantities}

    def columns(self) -> list[Column]:
        """Every column, with the samples of the piece that was decided last."""
        out = []
        for name, (topic, q, t_s, values) in self._kept.items():
            words = tuple(self._words) if isinstance(q.value, str) else None
            out.append(Column(name, q.unit, q.description, np.array(t_s), np.array(values), topic, words))
        return out

    def _add(self, d: Decision) -> None:
        self.decisions += 1
        for _, quantities in _told(d, self._before):
            for q in quantities:
                number = self._words.setdefault(q.value, len(self._words)) if isinstance(q.value, str) else q.value
                _, _, t_s, values = self._kept[q.name]
                if math.isfinite(number) and not (t_s and t_s[-1] >= d.t_s):  # one row for one time
                    t_s.append(d.t_s)
                    values.append(number)
        self._before = d

    def beside(
        self, pieces: Iterator[Piece], target: int | None, *, quiet: bool
    ) -> Iterator[tuple[Piece, list[Column]]]:
        """Every piece with the columns of its decisions."""
        own = None
        if suffix_of(self._path) != ".tlog":  # its frames are replayed, not its columns
            pieces, own = itertools.tee(pieces)
        played = play(self._path, self._config, target, self._assumed, quiet=quiet, pieces=own)
        self.decisions = 0
        self._start()
        waiting = next(played.decisions, None)
        for piece in pieces:
            while waiting is not None and (played.boots() - 1, waiting.t_s) < (piece.log.boot, piece.end_s):
                self._add(waiting)
                waiting = next(played.decisions, None)
            yield piece, self.columns()
            for _, _, t_s, values in self._kept.values():
                del t_s[:-1], values[:-1]  # the newest stands until the next
            if piece.end_s == math.inf:
                self._start()
