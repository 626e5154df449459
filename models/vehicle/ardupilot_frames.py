"""Which frame ArduPilot's parameters and start-up texts name.

Source: ArduPilot ``AP_Motors_Class.h`` and ``AP_MotorsMatrix.cpp`` (4.6), ``AP_MotorsQuad.cpp`` and the other classes
of ArduCopter 3.2 to 3.4.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from models.vehicle.motor_layouts import LAYOUTS

QUAD = 1
HEXA = 2
OCTA = 3
OCTAQUAD = 4
Y6 = 5
TRI = 7
DODECAHEXA = 12
DECA = 14
"""Values of FRAME_CLASS that are multirotors of fixed motors."""
_SCRIPTED = (15, 17)
"""Their motors are placed by a script on the vehicle."""
COUNT_OF_CLASS = {QUAD: 4, HEXA: 6, OCTA: 8, OCTAQUAD: 8, Y6: 6, TRI: 3, DODECAHEXA: 12, DECA: 10}

_TYPES: dict[tuple[int, int], str] = {}
"""FRAME_CLASS and FRAME_TYPE to name."""
for _frame, _layout in LAYOUTS.items():
    for _type in _layout.get("ardupilot_types", ()):
        _TYPES[_layout["ardupilot_class"], _type] = _frame
_ANY_OTHER_TYPE = {Y6: "y6", TRI: "tri"}
"""These classes take every other FRAME_TYPE as this frame."""

_OLD: dict[int, tuple[dict[int, str], str]] = {
    QUAD: ({0: "quad-plus", 2: "quad-v", 3: "quad-h", 4: "quad-vtail", 5: "quad-atail"}, "quad-x"),
    HEXA: ({0: "hexa-plus"}, "hexa-x"),
    OCTA: ({0: "octo-plus", 2: "octo-v"}, "octo-x"),
    OCTAQUAD: ({0: "octaquad-plus", 2: "octaquad-v", 3: "octaquad-h"}, "octaquad-x"),
    Y6: ({10: "y6b", 11: "y6f"}, "y6"),
    TRI: ({}, "tri"),
}
"""The same by FRAME of ArduCopter before 3.5, and the frame of every other value."""
_ALONE_ON_OLD = (QUAD, TRI)
"""Before 3.5 the vehicle type of a hexa is that of a Y6, and the one of an octo that of an octaquad."""

_CLASS_WORDS = {
    "QUAD": QUAD,
    "HEXA": HEXA,
    "OCTA": OCTA,
    "OCTAQUAD": OCTAQUAD,
    "OCTA_QUAD": OCTAQUAD,
    "Y6": Y6,
    "TRI": TRI,
    "DODECAHEXA": DODECAHEXA,
    "DODECA_HEXA": DODECAHEXA,
    "DECA": DECA,
}
_TYPE_WORDS = {
    "PLUS": 0, "X": 1, "V": 2, "H": 3, "VTAIL": 4, "ATAIL": 5, "PLUSREV": 6, "PITCH-REVERSED": 6, "Y6B": 10,
    "Y6F": 11, "BF_X": 12, "DJI_X": 13, "CW_X": 14, "X/CW_X": 14, "I": 15, "NYT_PLUS": 16, "NYT_X": 17, "X_REV": 18,
    "Y4": 19, "X_COR": 20, "CW_X_COR": 21, "DEFAULT": -1,
}  # fmt: skip
_TEXT = "Frame: "


@dataclass(frozen=True, kw_only=True)
class SaidFrame:
    """What a firmware says of its frame."""

    said: str
    """By which words."""
    name: str | None = None
    """In ``FRAMES``; None where the numbers are not in the firmware's list."""
    count: int | None = None
    """Of motors, where that is known."""
    unsure: str = ""
    """Why ``name`` does not say places and spins."""


def ardupilot_frame(parameters: Mapping[str, float]) -> str | None:
    """The name of the frame that FRAME_CLASS and FRAME_TYPE say, or None where they are not in the firmware's list."""
    frame_class = int(parameters.get("FRAME_CLASS", 0))
    return _named(frame_class, int(parameters.get("FRAME_TYPE", -1)))


def _named(frame_class: int, frame_type: int) -> str | None:
    return _TYPES.get((frame_class, frame_type), _ANY_OTHER_TYPE.get(frame_class))


def said_by_class(parameters: Mapping[str, float]) -> SaidFrame | None:
    """What FRAME_CLASS and FRAME_TYPE say, or None where FRAME_CLASS is not there or 0 (undefined)."""
    frame_class = int(parameters.get("FRAME_CLASS", 0))
    if frame_class <= 0:
        return None
    if frame_class in _SCRIPTED:
        why = "a script on the vehicle places the motors"
        return SaidFrame(said=f"FRAME_CLASS {frame_class}", unsure=why)
    count = COUNT_OF_CLASS.get(frame_class)
    if "FRAME_TYPE" not in parameters:
        said = f"FRAME_CLASS {frame_class}"
        return SaidFrame(said=said, count=count, unsure="FRAME_TYPE is not in the log")
    said = f"FRAME_CLASS {frame_class}, FRAME_TYPE {parameters['FRAME_TYPE']:g}"
    name = ardupilot_frame(parameters)
    if name:
        unsure = ""
    else:
        unsure = _not_known(frame_class, parameters["FRAME_TYPE"])
    return SaidFrame(said=said, name=name, count=count, unsure=unsure)


def _not_known(frame_class: int, frame_type: float) -> str:
    if frame_class not in COUNT_OF_CLASS:
        return f"FRAME_CLASS {frame_class} is not known"
    return f"FRAME_TYPE {frame_type:g} of FRAME_CLASS {frame_class} is not known"


def said_by_text(texts: Iterable[str]) -> SaidFrame | None:
    """What the start-up text ``Frame: CLASS/TYPE`` says."""
    for text in texts:
        if text.startswith(_TEXT):
            words = text.removeprefix(_TEXT).strip().upper()
        else:
            words = ""
        of_class, _, of_type = words.partition("/")
        frame_class = _CLASS_WORDS.get(of_class)
        if frame_class is None:
            continue
        count = COUNT_OF_CLASS[frame_class]
        if of_type in _TYPE_WORDS:
            name = _named(frame_class, _TYPE_WORDS[of_type])
        else:
            name = None
        if name:
            unsure = ""
        else:
            unsure = "it says no frame type that is known"
        return SaidFrame(said=f"'{text.strip()}'", name=name, count=count, unsure=unsure)
    return None


def class_of_text(texts: Iterable[str]) -> int | None:
    """FRAME_CLASS by the start-up text ``Frame: CLASS``."""
    words = (text.removeprefix(_TEXT) for text in texts if text.startswith(_TEXT))
    classes = (_CLASS_WORDS.get(word.partition("/")[0].strip().upper()) for word in words)
    return next((found for found in classes if found is not None), None)


def said_before_3_5(
    parameters: Mapping[str, float], texts: Iterable[str], count: int | None
) -> SaidFrame | None:
    """What FRAME of ArduCopter before 3.5 says, for a vehicle of ``count`` motors; None without FRAME or a class."""
    if "FRAME" not in parameters:
        return None
    class_said = class_of_text(texts)
    frame_class = class_said or {3: TRI, 4: QUAD, 6: HEXA, 8: OCTA}.get(count or 0)
    if frame_class not in _OLD:
        return None
    value = int(parameters["FRAME"])
    if class_said is None and frame_class == HEXA and value in _OLD[Y6][0]:
        frame_class = Y6
    names, other = _OLD[frame_class]
    sure = class_said is not None or frame_class in (*_ALONE_ON_OLD, Y6)
    twin = {HEXA: "a Y6", OCTA: "an octaquad"}.get(frame_class)
    return SaidFrame(
        said=f"FRAME {value}",
        name=names.get(value, other),
        count=COUNT_OF_CLASS[frame_class],
        unsure="" if sure else f"{twin} of this firmware says the same",
    )
