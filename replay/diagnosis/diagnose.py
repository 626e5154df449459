"""``replay diagnose`` as a function: logs in, what the declared model lacks out; one flight or several at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from models.effects import AdoptedEffect, InFlight
from models.errors import LogError
from models.frames import AXES, Array
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle
from replay.logs.formats import read_flightlogs
from replay.residual.record import Record, build_record, check_model
from replay.search.free_curves import Channel
from replay.search.search import Found, Rejected, Trace, trace

UNITS = ("N", "N", "N", "N m", "N m", "N m")
OWN_MOTION = ("wind", "rotor_drag", "body_drag")
RHYTHM_SHARE = 0.3
"""Share of the velocity that one line in time holds, from which on a force with that line may come from either."""
CONFIRM_SHARE = 0.01
CONFIRM_BLOCK_S = 5.0
_FROM_THE_START = "from_s"


@dataclass(frozen=True)
class Named:
    """An effect in the answer: where it was found best, and whether another flight bears it out."""

    found: Found
    record: int
    status: str
    """``candidate`` (one flight) or ``confirmed`` (frozen on one flight, it removes residual of another)."""
    explains: float


@dataclass(frozen=True)
class Diagnosis:
    """The answer to one question: what does the declared model lack on these flights?"""

    traces: tuple[Trace, ...]
    named: tuple[Named, ...]
    rejected: tuple[Rejected, ...]
    channels: tuple[Channel, ...]
    verdict: str
    notes: tuple[str, ...]

    @property
    def records(self) -> list[Record]:
        """The flights."""
        return [t.record for t in self.traces]

    def rms(self, *, after: bool) -> Array:
        """RMS per axis on held-out time of all flights, (6,); NaN where no flight could judge the axis."""
        energy, count = np.zeros(6), np.zeros(6)
        for t in self.traces:
            r = (t.after if after else t.before)[t.record.valid]
            judged = np.isin(np.arange(6), t.record.axes)
            energy += np.where(judged, (r**2).sum(axis=0), 0.0)
            count += np.where(judged, len(r), 0.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.sqrt(energy / count))

    @property
    def adopted(self) -> tuple[AdoptedEffect, ...]:
        """The named effects with their parameters, as found."""
        return tuple(AdoptedEffect(n.found.effect.name, n.found.parameters) for n in self.named)

    @property
    def aliases(self) -> list[list[str]]:
        """Effects that these flights cannot tell apart, each list led by the one that is named."""
        return [[n.found.effect.name, *n.found.aliases] for n in self.named if n.found.aliases]

    def as_json(self, model: str | None) -> dict[str, Any]:
        """Contract, section 6; ``status``, ``rejected``, ``delays``, ``excluded`` and ``notes`` are additions."""
        before, after = self.rms(after=False), self.rms(after=True)
        judged = [i for i in range(6) if np.isfinite(before[i])]
        return {
            "logs": list(dict.fromkeys(str(r.log.path) for r in self.records)),
            "samples": int(sum(r.valid.sum() for r in self.records)),
            "duration_s": round(sum(r.seconds for r in self.records), 3),
            "verdict": self.verdict,
            "axes": {
                AXES[i]: {"rms_before": _number(before[i]), "rms_after": _number(after[i]), "unit": UNITS[i]}
                for i in judged
            },
            "effects": [_effect_json(n) for n in self.named],
            "aliases": self.aliases,
            "unexplained": {
                "rms": {AXES[i]: _number(after[i]) for i in judged},
                "channels": [_channel_json(c) for c in self.channels],
            },
            "model": model,
            "rejected": [
                {"name": r.name, "reason": r.reason, "excited": r.excited, "p": r.p} for r in self.rejected
            ],
            "noise": {
                AXES[a]: {"rms": _number(t.noise.total[k]), "correlation_s": _number(t.noise.tau_s[k])}
                for t in self.traces[:1]
                for k, a in enumerate(t.record.axes)
            },
            "delays": [
                {
                    "log": r.name, "signal": d.signal, "seconds": _number(d.seconds),
                    "correlation": _number(d.correlation), "corrected": d.corrected,
                }
                for r in self.records
                for d in r.delays
            ],
            "excluded": [
                {"log": r.name, "reason": e.reason, "seconds": _number(e.seconds)}
                for r in self.records
                for e in r.excluded
            ],
            "notes": list(self.notes),
        }  # fmt: skip

    def as_text(self) -> str:
        """A few lines for a person."""
        before, after = self.rms(after=False), self.rms(after=True)
        seconds = sum(r.seconds for r in self.records)
        lines = [f"{self.verdict.replace('_', ' ')}  ({seconds:.0f} s of flight judged)"]
        for name, b, a, unit in zip(AXES, before, after, UNITS, strict=True):
            if np.isfinite(b):
                lines.append(f"  {name:3s} {b:8.3f} -> {a:8.3f} {unit}")
        for n in self.named:
            numbers = ", ".join(_estimate_text(e.value, e.ci95, e.name, e.unit) for e in n.found.estimates)
            lines.append(f"  {n.found.effect.name} ({n.status}): {numbers}; explains {n.explains:.0%}")
            if n.found.aliases:
                lines.append(f"    or {', '.join(n.found.aliases)}: to tell, {n.found.effect.excite}")
        for c in self.channels:
            lines.append(f"  unexplained in {c.axis}: {c.name}" + (f" at {c.peak_hz:.2f} Hz" if c.peak_hz else ""))
        return "\n".join([*lines, *(f"  note: {note}" for note in self.notes)])


def diagnose(
    paths: Sequence[Path],
    vehicle: Vehicle,
    model: FanSurrogate | None,
    *,
    target_system: int | None = None,
    seed: int = 0,
    progress: Callable[[list[Record]], Iterable[Record]] = lambda records: records,
) -> Diagnosis:
    """Read, compare, search, and answer. ``progress`` may wrap the records while they are searched."""
    check_model(vehicle, model)
    records, notes = _records(paths, vehicle, model, target_system)
    traces = [trace(record, seed=seed) for record in progress(records)]
    return conclude(traces, notes)


def conclude(traces: Sequence[Trace], notes: Sequence[str] = ()) -> Diagnosis:
    """One answer from the searches of one flight or several."""
    named = _named(traces)
    if len(traces) > 1:
        named = [replace(n, status=_status(n, named, traces)) for n in named]
    named, undecided = _beside_gusts(named, traces)
    channels = _channels(traces)
    verdict = {
        (False, False): "nothing_missing",
        (False, True): "unexplained",
        (True, False): "explained",
        (True, True): "partly_explained",
    }[bool(named), bool(channels)]
    taken = {n.found.effect.name for n in named}
    rejected = {r.name: r for t in reversed(traces) for r in t.rejected if r.name not in taken}
    all_notes = [
        *notes,
        *undecided,
        *_wind_speeds(named, traces),
        *dict.fromkeys(note for t in traces for note in t.record.notes),
    ]
    return Diagnosis(tuple(traces), tuple(named), tuple(rejected.values()), channels, verdict, tuple(all_notes))


def flown(effect: AdoptedEffect) -> bool:
    """Whether the flight program compensates this effect (or corrects a measurement by it)."""
    from models.effects import get

    return get(effect.name).in_flight is not InFlight.NONE


def _records(
    paths: Sequence[Path], vehicle: Vehicle, model: FanSurrogate | None, target_system: int | None
) -> tuple[list[Record], list[str]]:
    records: list[Record] = []
    notes: list[str] = []
    problems: list[LogError] = []
    effects = () if model is None else model.effects
    for path in paths:
        try:
            boots = read_flightlogs(path, target_system)
        except LogError as error:
            problems.append(error)
            continue
        for log in boots:
            name = path.name if len(boots) == 1 else f"{path.name} (boot {log.boot + 1})"
            try:
                records.append(build_record(log, vehicle, model, effects, name))
            except LogError as error:
                problems.append(error)
        if len(boots) > 1:
            notes.append(f"{path.name}: the vehicle started {len(boots)} times; every start is a flight of its own")
        notes += [f"{path.name}: {note}" for note in dict.fromkeys(n for log in boots for n in log.summary.notes)]
    if not records:
        raise problems[0]
    return records, notes + [f"left out: {p}" for p in problems]


def _named(traces: Sequence[Trace]) -> list[Named]:
    """Every effect once, from the flight on which it explains most, in the order of adoption."""
    best: dict[str, Named] = {}
    seconds = [t.record.seconds for t in traces]
    for i, t in enumerate(traces):
        for f in t.found:
            name = f.effect.name
            share = f.explains * seconds[i] / sum(seconds)
            if name not in best:
                best[name] = Named(f, i, "candidate", share)
                continue
            first = best[name]
            better = f.explains > first.found.explains
            best[name] = Named(
                f if better else first.found, i if better else first.record, "candidate", first.explains + share
            )
    return list(best.values())


def _status(named: Named, all_named: Sequence[Named], traces: Sequence[Trace]) -> str:
    """``confirmed`` where the effect, frozen, takes residual out of a flight that it was not fitted on."""
    for i, t in enumerate(traces):
        if i == named.record:
            continue
        others = [n for n in all_named if n is not named]
        rest = t.record.residual - sum((_frozen(n, t) for n in others), np.zeros((len(t.record.time_s), 6)))
        if removes(rest, _frozen(named, t), t):
            return "confirmed"
    return "candidate"


def removes(residual: Array, wrench: Array, t: Trace) -> bool:
    """Whether ``wrench`` (n, 6), not fitted here, lowers the residual's energy: 95 % bootstrap interval over blocks."""
    axes, valid = list(t.record.axes), t.record.valid
    left = residual[valid][:, axes] / t.noise.total
    gain = (left**2 - (left - wrench[valid][:, axes] / t.noise.total) ** 2).sum(axis=1)
    length = max(CONFIRM_BLOCK_S, 3.0 * float(t.noise.tau_s.max()))
    count = max(int(t.record.seconds / length), 2)
    blocks = np.array([part.sum() for part in np.array_split(gain, count)])
    draws = np.random.default_rng(0).choice(blocks, (1000, count)).sum(axis=1)
    return bool(np.percentile(draws, 2.5) > 0.0 and gain.sum() > CONFIRM_SHARE * (left**2).sum())


def _frozen(named: Named, t: Trace) -> Array:
    found = named.found
    if found.effect.lacking(t.record.context) is not None:
        return np.zeros((len(t.record.time_s), 6))
    parameters = found.parameters
    if _FROM_THE_START in parameters:
        same = next((f for f in t.found if f.effect.name == found.effect.name), None)
        # When a load was picked up is this flight's own affair; how heavy it is is not.
        parameters = {**parameters, _FROM_THE_START: same.parameters[_FROM_THE_START] if same else 0.0}
    wrench = found.effect.wrench(t.record.context, parameters)
    return np.nan_to_num(wrench, nan=0.0, posinf=0.0, neginf=0.0)


def _channels(traces: Sequence[Trace]) -> tuple[Channel, ...]:
    """Channels that carry what is left, best first; empty where that is noise, or the form error of what was found."""
    best: dict[str, Channel] = {}
    for c in (c for t in traces for c in t.riddle):
        if c.name not in best or c.score > best[c.name].score:
            best[c.name] = c
    return tuple(sorted(best.values(), key=lambda c: -c.score))


def _beside_gusts(named: Sequence[Named], traces: Sequence[Trace]) -> tuple[list[Named], list[str]]:
    """Drag on the own motion and a gust are one where what is left repeats in time as the motion does."""
    out, notes = list(named), []
    for i, n in enumerate(named):
        t = traces[n.record]
        if n.found.effect.name not in OWN_MOTION:
            continue
        for line in t.leftover.channels:
            if line.peak_hz is None or line.axis not in n.found.axes:
                continue
            if _repeats(t.record, line.peak_hz) < RHYTHM_SHARE:
                continue
            others = (a for a in OWN_MOTION[:2] if a != n.found.effect.name)
            aliases = tuple(dict.fromkeys((*n.found.aliases, *others)))
            out[i] = replace(n, found=replace(n.found, aliases=aliases))
            notes.append(
                f"{t.record.name}: undecidable whether a gust or drag on the own motion: both repeat at "
                f"{line.peak_hz:.2f} Hz in {line.axis}; fly in another rhythm"
            )
            break
    return out, notes


def _wind_speeds(named: Sequence[Named], traces: Sequence[Trace]) -> list[str]:
    """The wind by the vehicle's own drag, where that is clearly not momentum theory's, in which ``wind`` is given."""
    notes = []
    for n in named:
        by_name = {e.name: e for e in n.found.estimates}
        if n.found.effect.name != "wind":
            continue
        own = by_name["own_motion"]
        if own.ci95[0] <= 0.0 or own.ci95[0] <= 1.0 <= own.ci95[1]:
            continue
        north, east = (by_name[axis].value / own.value for axis in ("north", "east"))
        notes.append(
            f"{traces[n.record].record.name}: drag on the own motion is {own.value:.2g} of momentum theory's; if the "
            f"wind meets the same, it blows at {north:.2g} m/s to the north, {east:.2g} m/s to the east"
        )
    return notes


def _repeats(record: Record, hz: float) -> float:
    """Share of the energy of the level velocity that one line in time holds."""
    v = record.context.state.velocity_ned[record.valid][:, :2]
    if not np.isfinite(v).all():
        return 0.0
    phase = 2.0 * np.pi * hz * record.time_s[record.valid]
    line = np.stack([np.ones(len(phase)), np.sin(phase), np.cos(phase)], axis=1)
    moved = v - v.mean(axis=0)
    rest = v - line @ np.linalg.lstsq(line, v, rcond=None)[0]
    return float(1.0 - ((rest**2).sum(axis=0) / np.maximum((moved**2).sum(axis=0), 1e-12)).min())


def _effect_json(n: Named) -> dict[str, Any]:
    f = n.found
    return {
        "name": f.effect.name,
        "axes": list(f.axes),
        "parameters": {
            e.name: {"value": _number(e.value), "ci95": [_number(v) for v in e.ci95], "unit": e.unit}
            for e in f.estimates
        },
        "explains": _number(n.explains),
        "q_value": _number(f.q_value),
        "channels": list(f.effect.channels),
        "status": n.status,
        "equation": f.effect.equation,
        "sign": f.effect.sign,
        "stability": _number(f.stability),
    }


def _channel_json(c: Channel) -> dict[str, Any]:
    out: dict[str, Any] = {"name": c.name, "score": _number(c.score), "axes": [c.axis]}
    if c.lag_s is not None:
        out["lag_s"] = _number(c.lag_s)
    if c.peak_hz is not None:
        out["peak_hz"] = _number(c.peak_hz)
    return out


def _number(x: float) -> float:
    """Six digits are more than a log can tell."""
    return float(f"{float(x):.6g}") if np.isfinite(x) else 0.0


def _estimate_text(value: float, ci95: tuple[float, float], name: str, unit: str) -> str:
    return (
        f"{name} = {value:.3g} [{ci95[0]:.3g}, {ci95[1]:.3g}] {unit}"
        if ci95[1] > ci95[0]
        else f"{name} = {value:.3g} {unit}"
    )
