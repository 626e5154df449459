"""What ``replay diagnose`` would take from a log: the same stretches, refused for the same reasons."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

from models.errors import LogError
from models.frames import AXES
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle
from replay.diagnosis.stretches import Stretches
from replay.flightlog import FlightLog
from replay.residual.record import build_record

_OTHERS = "other stretches of this long log are judged"


@dataclass(frozen=True)
class Judged:
    """Seconds and axes of a boot that are judged, or the line that refuses it."""

    boot: int
    seconds: float
    axes: tuple[str, ...]
    refusal: str
    left_out_s: tuple[tuple[str, float], ...]
    one_of: int = 1
    """Of a long log one of so many stretches is judged."""

    def as_json(self) -> dict[str, Any]:
        """Plain numbers."""
        return {
            "seconds": round(self.seconds, 3),
            "axes": list(self.axes),
            "refusal": self.refusal or None,
            "left_out_s": {reason: round(s, 3) for reason, s in self.left_out_s},
            "one_of": self.one_of,
        }

    def as_text(self) -> list[str]:
        """Lines for a person."""
        if self.refusal:
            return [f"  replay diagnose refuses it: {self.refusal}"]
        rest = f" (one of every {self.one_of} stretches: a long log)" if self.one_of > 1 else ""
        out = [f"  replay diagnose judges {self.seconds:.0f} s of it in {' '.join(self.axes)}{rest}"]
        return [*out, *(f"    {s:6.1f} s left out: {reason}" for reason, s in self.left_out_s)]


class Judge:
    """Asks of every stretch of a log what a diagnosis would take of it."""

    def __init__(self, vehicle: Vehicle, model: FanSurrogate | None, refusal: str = "") -> None:
        self._vehicle, self._model, self._refusal = vehicle, model, refusal
        self._taken = Stretches[Judged]()
        self._refused: dict[int, Judged] = {}

    def add(self, log: FlightLog) -> None:
        """The next stretch."""
        if self._refusal or not self._taken.wants_next():
            return
        effects = () if self._model is None else self._model.effects
        try:
            record = build_record(log, self._vehicle, self._model, effects)
        except LogError as error:
            why = str(error).removeprefix(f"{log.path}: ")
            self._refused.setdefault(log.boot, Judged(log.boot, 0.0, (), why, ()))
            return
        left_out = tuple((e.reason, e.seconds) for e in record.excluded)
        self._taken.add(Judged(log.boot, record.seconds, tuple(AXES[i] for i in record.axes), "", left_out))

    def of(self, boot: int) -> Judged:
        """The answer on a boot, once every stretch was added."""
        if self._refusal:
            return Judged(boot, 0.0, (), self._refusal, ())
        own = [judged for judged in self._taken.records if judged.boot == boot]
        if not own:
            return self._refused.get(boot) or Judged(boot, 0.0, (), _OTHERS, ())
        left_out: Counter[str] = Counter()
        for judged in own:
            left_out.update(dict(judged.left_out_s))
        axes = tuple(a for a in AXES if any(a in judged.axes for judged in own))
        seconds = sum(judged.seconds for judged in own)
        return Judged(boot, seconds, axes, "", tuple(left_out.items()), self._taken.one_of)
