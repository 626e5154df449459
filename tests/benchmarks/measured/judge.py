"""Is an answer of ``replay diagnose`` right about a measured flight? By the table of what is known, and nothing else.

Reads the JSON that the command prints, so that it judges any way of finding the answer. Keys that it does not know are
left alone; ``probability``, ``at_bound``, ``outside`` and ``log_faults`` are used where an answer has them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from diagnosis.stated import Statement, number, statement

from .known import CATALOGUE, FORCES, Flight, Known

Answer = Mapping[str, Any]

CLOSED = frozenset({"nothing_missing", "explained"})
"""Verdicts that say that nothing unnamed is left."""
BEST_FACTOR = 1.2
TOP_CHANNELS = 3
LEAST_DELAY_S = 0.005
"""Shortest delay that counts as named: half a sample of a log at 100 Hz."""
OLD_NAMES = {"mass_kg": "mass", "length_m": "rope_m"}
"""What answers called a parameter before the fourth edition of the contract."""


@dataclass(frozen=True)
class Size:
    """One parameter whose true value is known."""

    effect: str
    parameter: str
    value: float
    ci95: tuple[float, float] | None
    low: float
    high: float
    right: bool


@dataclass(frozen=True)
class Axis:
    """RMS of one axis before and after, and what the best published fit leaves."""

    axis: str
    before: float
    after: float
    unit: str
    best: float | None


@dataclass(frozen=True)
class Judgement:
    """One flight's answer against what is known of it."""

    source: str
    kind: str
    flight: str
    again: bool
    verdict: str
    """The answer's, or ``refused``, or ``failed``."""
    note: str
    statements: tuple[Statement, ...] = ()
    missed: tuple[str, ...] = ()
    refused: bool = False
    excused: bool = False
    """Refused, and that is right: neither counted for nor against."""
    overclaim: str = ""
    verdict_wrong: bool = False
    sizes: tuple[Size, ...] = ()
    axes: tuple[Axis, ...] = ()
    seconds: float = 0.0

    @property
    def wrong(self) -> tuple[str, ...]:
        """Names that are wrong."""
        return tuple(s.effect for s in self.statements if s.named and s.right is False)

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of which nothing is known."""
        return tuple(s.effect for s in self.statements if s.named and s.right is None)

    @property
    def right(self) -> bool:
        """All that had to be said was said, nothing wrong, nothing claimed too much."""
        return not (
            self.wrong or self.missed or self.refused or self.overclaim or self.verdict_wrong
        )


def judge_refusal(
    flight: Flight, exit_code: int, complaint: str, seconds: float = 0.0
) -> Judgement:
    """Judge a command that gave no answer: exit code 3 is a refusal, any other a failure."""
    refused = exit_code == 3
    faults = [n.partition(":")[2] for group in flight.must for n in group if n.startswith("fault:")]
    reported = refused and any(f in complaint for f in faults)
    return Judgement(
        flight.source, flight.kind, flight.name, flight.again, "refused" if refused else "failed",
        complaint or f"exit code {exit_code}, silent", refused=not reported,
        excused=refused and flight.short and not reported, seconds=seconds,
    )  # fmt: skip


def judge(
    flight: Flight, known: Known, answer: Answer, weight_n: float, seconds: float = 0.0
) -> Judgement:
    """Judge the JSON ``answer`` on ``flight`` of a vehicle that weighs ``weight_n``."""
    effects = list(answer["effects"])
    verdict = str(answer["verdict"])
    statements = tuple(_statement(flight, known, answer, e) for e in effects) + _not_adopted(
        flight, answer
    )
    said = {s.effect for s in statements if s.named and s.right is not False}
    missed = tuple(
        "|".join(sorted(g)) for g in flight.must if not _satisfied(g, said, flight, known, answer)
    )
    axes = tuple(
        _axis(flight, name, a)
        for name, a in answer["axes"].items()
        if a.get("rms_after") is not None
    )
    names = ", ".join(str(e["name"]) for e in effects) or "no name"
    aliases = "; ".join("/".join(a) for a in answer.get("aliases", []))
    return Judgement(
        flight.source, flight.kind, flight.name, flight.again, verdict,
        f"{verdict}: {names}" + (f" (aliases {aliases})" if aliases else ""), statements, missed,
        overclaim=_overclaim(flight, answer, axes, weight_n), verdict_wrong=verdict not in flight.verdicts,
        sizes=_sizes(flight, effects), axes=axes, seconds=seconds,
    )  # fmt: skip


def _statement(
    flight: Flight, known: Known, answer: Answer, effect: Mapping[str, Any]
) -> Statement:
    name = str(effect["name"])
    right, why = _is_right(flight, known, answer, name)
    for limit in flight.limits:
        value = _value(flight, effect, limit.parameter) if limit.effect == name else None
        if value is not None and not limit.holds(value):
            right, why = (
                False,
                f"{limit.parameter} {value:.3g} is not within {limit.low:g} to {limit.high:g}",
            )
    return statement(effect, right, why)


def _is_right(flight: Flight, known: Known, answer: Answer, name: str) -> tuple[bool | None, str]:
    if name in flight.never:
        return False, "known not to be there"
    if name in flight.true:
        return True, ""
    stands_for = _stands_for(name, flight.true, known, answer)
    if stands_for:
        return True, f"said to be an alias of {'/'.join(sorted(stands_for))}"
    if name in flight.unknown or _stands_for(name, flight.unknown, known, answer):
        return None, "nothing is known"
    if name not in CATALOGUE:
        return None, "a name that the table does not foresee"
    return False, "known not to be there"


def _stands_for(name: str, names: frozenset[str], known: Known, answer: Answer) -> frozenset[str]:
    """Of ``names``: those not named themselves that the answer calls an alias of ``name``, and that can be one."""
    reported = {str(e["name"]) for e in answer["effects"]}
    classes = [frozenset(map(str, a)) for a in answer.get("aliases", [])]
    return frozenset(
        other
        for other in names - reported
        if any({name, other} <= c for c in classes)
        and any({name, other} <= kind for kind in known.aliases)
    )


def _satisfied(
    group: frozenset[str], said: set[str], flight: Flight, known: Known, answer: Answer
) -> bool:
    if group & said or any(group & _stands_for(name, flight.true, known, answer) for name in said):
        return True
    said_of_log = _said_of_log(answer)
    wanted = [n.partition(":") for n in group if ":" in n]
    return any(any(text.startswith(what) for text in said_of_log[kind]) for kind, _, what in wanted)


def _said_of_log(answer: Answer) -> Mapping[str, Sequence[str]]:
    """What an answer says beside effects, by kind as a table asks for it: ``fault:CHANNEL``, ``delay:SIGNAL`` ..."""
    channels = [str(c["name"]) for c in answer.get("unexplained", {}).get("channels", [])]
    delays = [d for d in answer.get("delays", []) if d["corrected"]]
    return {
        "fault": [str(f.get("channel", "")) for f in answer.get("log_faults", [])],
        "channel": channels[:TOP_CHANNELS],
        "delay": [str(d["signal"]) for d in delays if abs(d["seconds"]) >= LEAST_DELAY_S],
        "repeats": [str(r["signal"]) for r in answer.get("repeats", [])],
    }


def _not_adopted(flight: Flight, answer: Answer) -> tuple[Statement, ...]:
    """Probabilities of effects that were not adopted, for the reliability of low probabilities."""
    out = []
    for entry in answer.get("rejected", []):
        if entry.get("probability") is not None:
            name = str(entry["name"])
            needed = any(name in group for group in flight.must)
            thin = name in flight.may | flight.unknown and not needed
            out.append(statement(entry, None if thin else needed, "not adopted", named=False))
    return tuple(out)


def _overclaim(flight: Flight, answer: Answer, axes: Sequence[Axis], weight_n: float) -> str:
    if answer["verdict"] not in CLOSED:
        return ""
    if flight.open:
        return f"{answer['verdict']}, but something acts that no channel records"
    for a in axes:
        limit = max(flight.left_share * weight_n, BEST_FACTOR * (a.best or 0.0))
        if a.axis in flight.axes and a.axis in FORCES and a.after > limit:
            return f"{a.axis} {a.after:.3g} N is left, {a.after / weight_n:.0%} of the weight"
    if answer.get("outside") or answer.get("unexplained", {}).get("channels"):
        return f"{answer['verdict']}, but the answer itself lists a remainder"
    return ""


def _axis(flight: Flight, name: str, entry: Mapping[str, Any]) -> Axis:
    return Axis(
        name,
        float(entry["rms_before"]),
        float(entry["rms_after"]),
        str(entry["unit"]),
        dict(flight.best).get(name),
    )


def _sizes(flight: Flight, effects: Sequence[Mapping[str, Any]]) -> tuple[Size, ...]:
    out = []
    for effect in effects:
        for r in flight.sizes:
            if r.effect != effect["name"]:
                continue
            entry = _entry(flight, effect, r.parameter)
            value = number(entry.get("value"))
            if value is None:
                continue
            ci = entry.get("ci95")
            interval = (float(ci[0]), float(ci[1])) if ci else None
            out.append(Size(r.effect, r.parameter, value, interval, r.low, r.high, r.holds(value)))
    return tuple(out)


def _value(flight: Flight, effect: Mapping[str, Any], parameter: str) -> float | None:
    return number(_entry(flight, effect, parameter).get("value"))


def _entry(flight: Flight, effect: Mapping[str, Any], parameter: str) -> Mapping[str, Any]:
    """A parameter of an answer's effect, by today's name or an older one.

    ValueError where it has none of these: a size that the table asks for must not go unjudged in silence. An answer
    without any parameters gives names alone, and has no sizes to judge.
    """
    parameters: Mapping[str, Mapping[str, Any]] = effect.get("parameters", {})
    for name in (parameter, OLD_NAMES.get(parameter)):
        if name in parameters:
            return parameters[name]
    if not parameters:
        return {}
    asked = f"{effect['name']}.{parameter}"
    raise ValueError(
        f"{flight.source}: {flight.name}: the table asks for {asked}; the answer has {sorted(parameters)}"
    )
