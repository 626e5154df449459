"""The form: the numbers of a drafted vehicle, a question, and the command of ``replay`` that answers it."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from starlette.exceptions import HTTPException

from replay.desk.store import Ask, Drop, one_of
from replay.vehicle.given import INCH_M


@dataclass(frozen=True)
class Field:
    """A number that the form shows in a unit of people: ``scale`` times the vehicle file's."""

    key: str
    words: str
    unit: str
    option: str
    """Of ``replay diagnose``."""
    scale: float = 1.0

    def shown(self, value: Any) -> str:
        """In the form's unit; empty where it is no number."""
        if isinstance(value, int | float):
            return f"{self.scale * value:.4g}"
        return ""

    def hint(self, source: str) -> str:
        """Where the number comes from; a range in the form's unit, and no option of the command line."""
        said = re.sub(r"; --\w+ \w+ gives it(; an arm's length)?", "", source)
        return re.sub(
            r"^([\d.e-]+) to ([\d.e+-]+)",
            lambda m: " to ".join(map(self.shown, map(float, m.groups()))),
            said,
        )


FIELDS = {
    field.key: field
    for field in (
        Field("mass_kg", "mass, with battery", "kg", "--mass"),
        Field("rotor_radius_m", "propeller, diameter", "inch", "--propeller", 2.0 / INCH_M),
        Field("position_m", "span, motor axis to the opposite one", "m", "--span", 2.0),
    )
}


def in_words(failure: str) -> str:
    """What the command line says of a number, by the words of the form."""
    for field in FIELDS.values():
        failure = re.sub(rf"{field.option} (\S+): ", rf"{field.words}: \1 ", failure)
    return failure


def rows(facts: Sequence[Mapping[str, Any]]) -> list[tuple[Field, str, str]]:
    """The lines of the form for the facts of a draft: a field, what the draft says, a hint."""
    known = {fact["key"]: (fact["value"], fact["from"]) for fact in facts}
    shown = [(field, *known.get(key, (None, ""))) for key, field in FIELDS.items()]
    return [(field, field.shown(value), field.hint(source)) for field, value, source in shown]


def others(facts: Sequence[Mapping[str, Any]]) -> list[str]:
    """Facts of a draft that the form has no field for, one line each."""
    return [
        f"{fact['key']} {fact['value']}: {fact['from']}"
        for fact in facts
        if fact["key"] not in FIELDS
    ]


class Asked(StrEnum):
    """What is asked, by the name that the form sends."""

    MISSING = "missing"
    CHANGED = "changed"
    SEASON = "season"


@dataclass(frozen=True)
class Question:
    """What is asked about the logs of a drop."""

    kind: Asked
    good: tuple[str, ...] = ()
    """Names of logs."""
    numbers: tuple[tuple[str, str], ...] = ()
    """By the key of their field, as typed."""
    vehicle: str = ""
    """The text of a vehicle file, which then stands for all numbers."""

    @classmethod
    def of(cls, form: Sequence[tuple[str, str]], drop: Drop) -> Question:
        """As the form sends it. Raises HTTPException where it makes no sense."""
        given = dict(form)
        if given.get("kind") not in set(Asked):
            raise HTTPException(400, f"kind: must be one of {', '.join(Asked)}")
        kind = Asked(given["kind"])
        logs = drop.logs
        if kind == Asked.CHANGED:
            good = tuple(one_of(logs, value).name for key, value in form if key == "good")
        else:
            good = ()
        if not logs:
            raise HTTPException(400, "there is no log here: drop one")
        if kind == Asked.CHANGED and not 0 < len(good) < len(logs):
            raise HTTPException(
                400, "tick the good logs, and leave at least one that is asked about"
            )
        if "edited" in given:
            return cls(kind, good, vehicle=given.get("vehicle", ""))
        return cls(
            kind,
            good,
            tuple((key, text.strip()) for key, text in form if key in FIELDS and text.strip()),
        )

    @classmethod
    def again(cls, ask: Ask, drop: Drop) -> Question:
        """As it was asked before. Raises HTTPException where one of its logs is gone."""
        said = ask.question
        for name in said["good"]:
            one_of(drop.logs, name)
        return cls(
            kind=Asked(said["kind"]),
            good=tuple(said["good"]),
            numbers=tuple((key, text) for key, text in said["numbers"]),
            vehicle=said["vehicle"],
        )

    def written(self, drop: Drop) -> Ask:
        """As one more question about the logs."""
        folder = drop.folder / "asks" / str(len(drop.asks) + 1)
        folder.mkdir()
        (folder / "question.json").write_text(json.dumps(asdict(self)), encoding="utf-8")
        if self.vehicle:
            (folder / "edited.toml").write_text(self.vehicle, encoding="utf-8")
        if self.kind == Asked.SEASON:
            # Pages of single logs lie beside their answers, which the next question takes over.
            (drop.each / "logs").mkdir(parents=True, exist_ok=True)
            (folder / "logs").symlink_to(Path("..", "..", drop.each.name, "logs"))
        return Ask(folder)

    def command(self, drop: Drop, ask: Ask) -> list[str]:
        """The arguments of ``replay``."""
        place = ask.folder
        vehicle = [f"{FIELDS[key].option}={text}" for key, text in self.numbers]
        if self.vehicle:
            vehicle = [f"--vehicle={place / 'edited.toml'}"]
        logs = [str(log) for log in drop.logs if log.name not in self.good]
        if self.kind == Asked.SEASON:
            logs = [str(drop.folder / "logs"), f"--out={drop.each}", "--workers=1", "--retry"]
        elif self.kind == Asked.CHANGED:
            logs += ["--since", *(str(log) for log in drop.logs if log.name in self.good)]
        elif not self.vehicle:
            vehicle.append(f"--save-vehicle={place / 'vehicle.toml'}")
        return [
            "diagnose",
            *logs,
            *vehicle,
            f"--report={place}",
            f"--json={place / 'answer.json'}",
            "--quiet",
        ]

    def over_time(self, drop: Drop, ask: Ask) -> list[str]:
        """Of the command that makes the page of every vehicle over time; none where that was not asked."""
        if self.kind != Asked.SEASON:
            return []
        return ["season", str(drop.each), f"--report={ask.folder / 'season'}", "--quiet"]
