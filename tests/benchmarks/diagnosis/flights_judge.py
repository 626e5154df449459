"""Is an answer of ``replay diagnose`` on a flight of the first simulator right?

The rules were fixed before any result; ``docs/lab/diagnose-suite.md``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from diagnosis.stated import Statement, statement

AXES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
ALIAS_CLASSES: tuple[tuple[frozenset[str], str], ...] = (
    (
        frozenset({"payload", "thrust_scale", "air_density"}),
        "IMU and rpm see only the ratio of thrust to mass",
    ),
    (
        frozenset({"battery_sag", "thermal_derating"}),
        "one flight empties the pack and heats the motors together",
    ),
    (
        frozenset({"rotor_drag", "body_drag"}),
        "linear and quadratic drag differ only over a wide range of speeds",
    ),
)
"""Pairs that one flight may not tell apart: a name from the true effect's class counts if ``aliases`` says both."""

STATIC_PART: dict[str, frozenset[str]] = {"slung_load": frozenset({"payload"})}
"""Names that may come along with a true one because it contains them: a hanging load is also a payload."""

THRUST_TO_MASS = ALIAS_CLASSES[0][0]
MUST_FIND = ("bad_mass_low", "bad_mass_high", "bad_reboot_payload", "bad_two_vehicles_wind")
REFUSABLE = ("bad_no_rpm", "bad_no_imu", "bad_20s", "bad_20s_wind")
"""Flights that a one-line error (exit code 3) answers as well."""
ALLOWED: dict[str, frozenset[str]] = {
    "bad_mass_low": THRUST_TO_MASS,
    "bad_mass_high": THRUST_TO_MASS,
    "bad_hover_only_cg": frozenset({"cg_offset", "fan_imbalance"}),
}
TOP_CHANNELS = 3


@dataclass(frozen=True)
class Judgement:
    """One flight's answer against the truth."""

    right: bool
    exact: bool
    """Right without help from an alias entry."""
    wrong_names: tuple[str, ...]
    missed: tuple[str, ...]
    note: str
    rms_ratio: float
    """RMS after over the oracle's, on the axes that carry the effect; NaN where there is none."""
    statements: tuple[Statement, ...] = ()


def judge(
    name: str, truth: Mapping[str, Any], answer: Mapping[str, Any] | None, exit_code: int
) -> Judgement:
    """Judge the JSON ``answer`` (None where the command failed) on flight ``name``."""
    if answer is None:
        fine = exit_code == 3 and name in REFUSABLE
        return Judgement(fine, fine, (), (), f"exit code {exit_code}", float("nan"))
    judged = _judge(name, truth, answer)
    return replace(
        judged,
        statements=tuple(
            statement(e, e["name"] not in judged.wrong_names) for e in answer["effects"]
        ),
    )


def _judge(name: str, truth: Mapping[str, Any], answer: Mapping[str, Any]) -> Judgement:
    reported = {str(e["name"]) for e in answer["effects"]}
    aliases = [set(map(str, pair)) for pair in answer.get("aliases", [])]
    verdict = str(answer["verdict"])
    note = f"{verdict}: {', '.join(sorted(reported)) or 'no name'}"
    if aliases:
        note += f" (aliases {'; '.join('/'.join(sorted(a)) for a in aliases)})"
    group = truth["group"]
    ratio = rms_ratio(truth, answer)
    if group == "null" or (group == "bad" and not truth["effects"]):
        right = not reported and verdict == "nothing_missing"
        return Judgement(right, right, tuple(sorted(reported)), (), note, ratio)
    if group == "unlisted":
        named = [str(c["name"]) for c in answer.get("unexplained", {}).get("channels", [])][
            :TOP_CHANNELS
        ]
        found = any(_matches(c, wanted) for c in named for wanted in truth["channels"])
        right = verdict == "unexplained" and not reported and found
        return Judgement(
            right, right, tuple(sorted(reported)), (), f"{note}; channels {named}", ratio
        )
    if group == "bad":
        allowed = frozenset(truth["effects"]) | ALLOWED.get(name, frozenset())
        wrong = reported - allowed
        found = bool(reported & allowed)
        right = not wrong and (found or name not in MUST_FIND)
        missed = () if found or name not in MUST_FIND else tuple(truth["effects"])
        return Judgement(right, right, tuple(sorted(wrong)), missed, note, ratio)
    wanted = set(truth["effects"])
    missed_names = set()
    used = set()
    exact = True
    for effect in wanted:
        if effect in reported:
            used.add(effect)
            used |= reported & STATIC_PART.get(effect, frozenset())
            continue
        stand_in = {
            other
            for other in reported - wanted
            for kind, _ in ALIAS_CLASSES
            if {effect, other} <= kind and any({effect, other} <= a for a in aliases)
        }
        exact = False
        if stand_in:
            used.add(min(stand_in))
        else:
            missed_names.add(effect)
    wrong = reported - used
    right = not wrong and not missed_names
    return Judgement(
        right, right and exact, tuple(sorted(wrong)), tuple(sorted(missed_names)), note, ratio
    )


def rms_ratio(truth: Mapping[str, Any], answer: Mapping[str, Any]) -> float:
    """RMS after over oracle RMS on the carrying axes, at the bandwidth whose RMS before agrees best with the answer."""
    axes = answer.get("axes", {})
    use = [
        a
        for a in AXES
        if a in axes and axes[a].get("rms_before") and axes[a].get("rms_after") is not None
    ]
    carrying = [a for a in truth["axes_carrying_it"] or use if a in use]
    if not carrying:
        return float("nan")
    hz = np.array(sorted(float(b) for b in truth["rms_by_bandwidth_hz"]))
    tables = [truth["rms_by_bandwidth_hz"][f"{b:g}"] for b in hz]
    before = np.array([[t["before"][AXES.index(a)] for a in use] for t in tables])
    oracle = np.array([[t["oracle"][AXES.index(a)] for a in carrying] for t in tables])
    said = np.array([axes[a]["rms_before"] for a in use])
    fine = np.linspace(np.log(hz[0]), np.log(hz[-1]), 61)

    def at(table: Any) -> Any:
        return np.stack([np.interp(fine, np.log(hz), column) for column in table.T], axis=-1)

    best = int(np.argmin((np.log(at(before) / said) ** 2).sum(axis=1)))
    after = np.array([axes[a]["rms_after"] for a in carrying])
    return float(np.sqrt(np.mean((after / at(oracle)[best]) ** 2)))


def _matches(channel: str, wanted: str) -> bool:
    return channel.startswith(wanted[:-1]) if wanted.endswith("*") else channel == wanted
