"""Is an answer of ``replay diagnose`` on a flight of the second simulator right? By the physics of the flights.

``docs/lab/independent-simulator.md`` says what was corrected after answers were seen.

An effect has to be named from 2 % of the weight on (95th percentile below 2 Hz; of a moment: of weight times arm). What
is there but smaller may be named, in its own size. What is not there (less than 0.1 %, and never 2 %) may not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

from diagnosis.stated import Statement, statement

NEEDED = 0.02
THERE = 0.001

ALIKE: tuple[tuple[frozenset[str], str], ...] = (
    (
        frozenset({"payload", "thrust_scale", "air_density"}),
        "accelerometer and rotors see the ratio of thrust to mass",
    ),
    (
        frozenset({"thrust_curve", "thrust_scale"}),
        "a scale is the level of a curve, flown near one throttle only",
    ),
    (
        frozenset({"battery_sag", "thermal_derating"}),
        "one flight empties the pack and heats the windings together",
    ),
    (
        frozenset({"battery_sag", "thrust_scale"}),
        "a pack that stands off the declared voltage all the time is a scale",
    ),
    (
        frozenset({"rotor_drag", "body_drag"}),
        "linear and quadratic drag differ over a wide range of speeds only",
    ),
    (
        frozenset({"cg_offset", "fan_imbalance"}),
        "one weak rotor makes the moment of an offset; lift and yaw tell them",
    ),
    (frozenset({"ground_effect", "range_offset"}), "both change lift near the ground only"),
    (frozenset({"contact", "wall_effect"}), "both act at the wall only"),
    (frozenset({"second_wall", "wall_effect"}), "the same law at two walls that meet"),
    (
        frozenset({"gyroscopic", "rotor_inertia"}),
        "the flywheel as a whole, and what of it follows from the rotors alone",
    ),
    (
        frozenset({"momentum_thrust", "vertical_inflow"}),
        "one law of the induced flow, whole and for slow motion",
    ),
)
"""Names that one flight may not tell apart: one stands for the other if the answer's ``aliases`` says both."""

CONTAINS: dict[str, tuple[str, ...]] = {
    "slung_load": ("payload",),
    "wind": ("vertical_inflow", "rotor_drag"),
    "gyroscopic": ("rotor_inertia",),
    "vertical_inflow": ("momentum_thrust",),
}
"""Names that a true effect contains: the weight of what hangs, the wind's part along the rotors' axes, the reaction of
rotors that speed up, lift that is gained in level flight."""

ALWAYS = frozenset({"imu_bias"})
"""There in every flight: the accelerometer's bias walks by some mg, as on a board that warms up."""


@dataclass(frozen=True)
class Judgement:
    """One answer against the truth."""

    right: bool
    exact: bool
    """Right without help from an alias."""
    wrong: tuple[str, ...]
    missed: tuple[str, ...]
    named: tuple[str, ...]
    """Needed effects that were named, or stood for by a stated alias."""
    overclaimed: bool
    """Says that all is explained while something of 2 % of the weight is not."""
    silent: bool
    """No name at all."""
    note: str
    statements: tuple[Statement, ...] = ()


def judge(
    truth: Mapping[str, Any], answer: Mapping[str, Any] | None, complaint: str = ""
) -> Judgement:
    """Judge the JSON ``answer``; None where the command gave none."""
    sizes: Mapping[str, float] = truth["sizes"]
    needed = needed_of(truth)
    strange = {n for n, s in sizes.items() if s >= NEEDED and n.startswith("x_")}
    if answer is None:
        return Judgement(
            False, False, (), tuple(sorted(needed)), (), False, True, complaint or "no answer"
        )
    there = {n for n, s in sizes.items() if s >= THERE and not _outside(n)} | ALWAYS
    # What touches a wall for some seconds in all is there, too.
    there |= {n for n, s in truth["largest"].items() if s >= NEEDED and not _outside(n)}
    there |= {inner for n in there for inner in CONTAINS.get(n, ())}
    if sizes.get("payload", 0.0) >= THERE and truth["payload_moment"] >= THERE:
        there.add("cg_offset")
    said = {str(a) for a in answer.get("aliases", []) for a in combinations(sorted(map(str, a)), 2)}
    reported = {str(e["name"]): e for e in answer["effects"]}
    stands = {
        n: {t for t in there if t != n and _alike(n, t) and str(tuple(sorted((n, t)))) in said}
        for n in reported
    }
    wrong = {n for n in reported if n not in there and not stands[n]}
    for name, effect in reported.items():
        holders = {outer for outer, inner in CONTAINS.items() if name in inner} | (
            {"payload"} if name == "cg_offset" else set()
        )
        size = max(sizes.get(n, 0.0) for n in {name, *stands[name], *holders})
        if (
            name not in wrong
            and size < NEEDED
            and claimed_size(effect, truth, answer) > 2.0 * size + 0.5 * NEEDED
        ):
            wrong.add(name)  # a small effect in a size that somebody would act upon
    covered = {t for n in reported if n not in wrong for t in stands[n] | {n}}
    missed = needed - covered
    verdict = str(answer["verdict"])
    complete = verdict in ("explained", "nothing_missing") and not answer.get("outside")
    overclaimed = complete and bool(strange or missed)
    right = not wrong and not missed and not overclaimed
    if truth["group"] == "null":
        right = right and verdict in ("explained", "nothing_missing")
    note = f"{verdict}: {', '.join(reported) or 'no name'}"
    if answer.get("aliases"):
        note += f" (aliases {'; '.join('/'.join(map(str, a)) for a in answer['aliases'])})"
    channels = [str(c["name"]) for c in answer.get("unexplained", {}).get("channels", [])][:3]
    note += f" channels {channels}" if channels else ""
    return Judgement(
        right, right and needed <= set(reported), tuple(sorted(wrong)), tuple(sorted(missed)),
        tuple(sorted(needed & covered)), overclaimed, not reported, note,
        tuple(statement(e, n not in wrong) for n, e in reported.items()),
    )  # fmt: skip


def needed_of(truth: Mapping[str, Any]) -> set[str]:
    """Effects of the catalogue that are worth a pilot's attention; a lag only beyond what a constant delay undoes."""
    sizes = {**truth["sizes"], "motor_lag": truth["lag_beyond_delay"]}
    return {n for n, s in sizes.items() if s >= NEEDED and not _outside(n)}


def _outside(name: str) -> bool:
    return name.startswith("x_") or name == "rest"


def _alike(a: str, b: str) -> bool:
    return any({a, b} <= kind for kind, _ in ALIKE)


def claimed_size(
    effect: Mapping[str, Any], truth: Mapping[str, Any], answer: Mapping[str, Any]
) -> float:
    """RMS that the answer says an effect removes, as a share of weight or of weight times arm: an upper estimate."""
    share = max(float(effect.get("explains") or 0.0), 0.0) ** 0.5
    scale = {
        "N": truth["weight_n"],
        "N m": truth["weight_n"] * truth["arm_m"],
        "Nm": truth["weight_n"] * truth["arm_m"],
    }
    axes = [answer["axes"][a] for a in effect.get("axes", []) if a in answer["axes"]]
    return max(
        (share * float(a["rms_before"]) / scale.get(str(a["unit"]), scale["Nm"]) for a in axes),
        default=0.0,
    )
