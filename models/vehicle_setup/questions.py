"""Questions to a person at a terminal: each is asked again, saying what is wanted, until its answer can be used."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from models.errors import ConfigError
from models.vehicle_setup.frames import FRAMES

MOST = {
    "mass": 1e4, "span": 20.0, "propeller": 200.0, "duct": 10.0, "hover_rpm": 2e5, "voltage": 1e3, "hover_thrust": 1.0,
}  # fmt: skip
"""Largest believable numbers by option; all are above 0."""
_TEXTS = {
    "name": "What is the vehicle called?",
    "mass": "Mass ready to fly, with battery [kg]?",
    "frame": f"Frame ({', '.join(FRAMES)})?",
    "span": "Span: motor axis to the opposite motor's axis [m]?",
    "propeller": "Diameter of the propellers [inch]?",
    "voltage": "Battery voltage in hover [V]?",
}
_RANGE = (
    "A rangefinder, such as 25:0,0,0.05 (25 looks down, 0 ahead, 2 right, 4 back, 6 left; then where it sits: forward, "
    "right, down of the CG [m]; empty: no more)?"
)


def completed(
    given: Mapping[str, Any], placed: bool, sensed: bool, read_range: Callable[[str], object]
) -> dict[str, Any]:
    """The options, those that are missing asked for. ``placed``: rotors, ``sensed``: rangefinders are known already.

    ``read_range`` raises ConfigError for an answer that is no rangefinder, and so does this where the answers end
    before the questions.
    """

    def ranged(text: str) -> str:
        if text:
            read_range(text)
        return text

    out = dict(given)
    missing = [o for o in _TEXTS if out[o] is None and not (placed and o in ("frame", "span")) and o != "voltage"]
    for option in missing:
        out[option] = ask(_TEXTS[option], partial(_answer, option))
    if missing and not out["no_rpm"]:
        out["no_rpm"] = not ask("Do the ESCs report rotor speeds to the autopilot (yes or no)?", _yes)
    if out["no_rpm"] and out["voltage"] is None:
        out["voltage"] = ask(_TEXTS["voltage"], partial(_answer, "voltage"))
    if missing and not out["range"] and not sensed:
        while text := ask(_RANGE, ranged):
            out["range"] = [*out["range"], text]
    return out


def ask(text: str, read: Callable[[str], Any]) -> Any:
    """One answer; ``read`` raises ValueError or ConfigError that says what is wanted."""
    while True:
        try:
            answer = input(f"{text} ").strip()
        except EOFError:
            raise ConfigError("the answers ended before the questions: nothing is written") from None
        try:
            return read(answer)
        except (ValueError, ConfigError) as error:
            print(error, file=sys.stderr)


def _answer(option: str, text: str) -> str | float:
    if option == "name" and text:
        return text
    if option == "frame" and text in FRAMES:
        return text
    if option in MOST:
        try:
            value = float(text)
        except ValueError:
            value = 0.0
        if 0.0 < value <= MOST[option]:
            return value
        raise ValueError(f"a number above 0 and at most {MOST[option]:g}, please")
    raise ValueError(f"one of {', '.join(FRAMES)}, please" if option == "frame" else "a few words, please")


def _yes(text: str) -> bool:
    if text.lower() not in ("y", "yes", "n", "no"):
        raise ValueError("yes or no, please")
    return text.lower().startswith("y")
