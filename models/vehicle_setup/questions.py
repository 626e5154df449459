"""Questions to a person at a terminal: each is asked again, saying what is wanted, until its answer can be used."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from typing import Any

from models.errors import ConfigError

FRAMES = ("quad-x", "quad-plus", "hexa-x", "hexa-plus", "octo-x", "octo-plus", "octaquad-x")
# Spelled out here so that --help imports nothing.
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
_SENSORS = (
    ("Where does the rangefinder that looks down sit: forward, right, down of the CG [m] (empty: none)?", "25"),
    ("Orientation of the rangefinder that looks at the wall: 0 ahead, 2 right, 4 back, 6 left (empty: none)?", ""),
)


def completed(given: Mapping[str, Any], placed: bool, sensed: bool) -> dict[str, Any]:
    """The options, those that are missing asked for. ``placed``: rotors, ``sensed``: rangefinders are known already.

    Raises ConfigError where the answers end before the questions.
    """
    out = dict(given)
    asked = False
    for option, text in _TEXTS.items():
        if out[option] is not None or (placed and option in ("frame", "span")):
            continue
        if option == "voltage":
            if asked and not out["no_rpm"]:
                out["no_rpm"] = not ask("Do the ESCs report rotor speeds to the autopilot (yes or no)?", _yes)
            if not out["no_rpm"]:
                continue
        out[option] = ask(text, _reader(option))
        asked = True
    if asked and not out["range"] and not sensed:
        out["range"] = _ranges()
    return out


def ask(text: str, read: Callable[[str], Any]) -> Any:
    """One answer; ``read`` raises ValueError that says what is wanted."""
    while True:
        try:
            answer = input(f"{text} ").strip()
        except EOFError:
            raise ConfigError("the answers ended before the questions: nothing is written") from None
        try:
            return read(answer)
        except ValueError as error:
            print(error, file=sys.stderr)


def _reader(option: str) -> Callable[[str], Any]:
    if option == "name":
        return _words
    return _frame if option == "frame" else lambda text: _number(text, MOST[option])


def _words(text: str) -> str:
    if not text:
        raise ValueError("a few words, please")
    return text


def _frame(text: str) -> str:
    if text not in FRAMES:
        raise ValueError(f"one of {', '.join(FRAMES)}, please; for another frame give --params, or edit a shipped file")
    return text


def _number(text: str, most: float) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value <= most:
        raise ValueError(f"a number above 0 and at most {most:g}, please")
    return value


def _yes(text: str) -> bool:
    if text.lower() not in ("y", "yes", "n", "no"):
        raise ValueError("yes or no, please")
    return text.lower().startswith("y")


def _orientation(text: str) -> str:
    if text and not text.isdecimal():
        raise ValueError("a number of MAV_SENSOR_ORIENTATION, such as 0, please; or nothing")
    return text


def _place(text: str) -> str:
    try:
        numbers = [float(part) for part in text.split(",")] if text else []
    except ValueError:
        numbers = [math.nan]
    if text and (len(numbers) != 3 or not all(map(math.isfinite, numbers))):
        raise ValueError("three numbers with commas between, such as 0,0,0.05, please; or nothing")
    return text


def _ranges() -> list[str]:
    (down, orientation), (wall, _) = _SENSORS
    place = ask(down, _place)
    out = [f"{orientation}:{place}"] if place else []
    orientation = ask(wall, _orientation)
    place = ask("Where does it sit: forward, right, down of the CG [m]?", _place) if orientation else ""
    return [*out, f"{orientation}:{place}"] if place else out
