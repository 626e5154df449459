"""A question as the form asks it, and the command of ``replay`` that answers it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum

from starlette.exceptions import HTTPException

from replay.desk.fields import FIELDS
from replay.desk.store import Ask, Drop, one_of


class Kind(StrEnum):
    """What is asked, by the name that the form sends."""

    MISSING = "missing"
    CHANGED = "changed"
    SEASON = "season"


@dataclass(frozen=True)
class Question:
    """What is asked about the logs of a drop."""

    kind: Kind
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
        if given.get("kind") not in set(Kind):
            raise HTTPException(400, f"kind: must be one of {', '.join(Kind)}")
        kind, logs = Kind(given["kind"]), drop.logs
        good = tuple(one_of(logs, value).name for key, value in form if key == "good") if kind == Kind.CHANGED else ()
        if not logs:
            raise HTTPException(400, "there is no log here: drop one")
        if kind == Kind.CHANGED and not 0 < len(good) < len(logs):
            raise HTTPException(400, "tick the good logs, and leave at least one that is asked about")
        if "edited" in given:
            return cls(kind, good, vehicle=given.get("vehicle", ""))
        return cls(kind, good, tuple((key, text.strip()) for key, text in form if key in FIELDS and text.strip()))

    def written(self, drop: Drop) -> Ask:
        """As one more question about the logs."""
        folder = drop.folder / "asks" / str(len(drop.asks) + 1)
        folder.mkdir()
        (folder / "question.json").write_text(json.dumps(asdict(self)), encoding="utf-8")
        if self.vehicle:
            (folder / "edited.toml").write_text(self.vehicle, encoding="utf-8")
        return Ask(folder)

    def command(self, drop: Drop, ask: Ask) -> list[str]:
        """The arguments of ``replay``."""
        place = ask.folder
        vehicle = [f"{FIELDS[key].option}={text}" for key, text in self.numbers]
        if self.vehicle:
            vehicle = [f"--vehicle={place / 'edited.toml'}"]
        logs = [str(log) for log in drop.logs if log.name not in self.good]
        if self.kind == Kind.SEASON:
            logs = [str(drop.folder / "logs"), f"--out={place / 'each'}", "--workers=1"]
        elif self.kind == Kind.CHANGED:
            logs += ["--since", *(str(log) for log in drop.logs if log.name in self.good)]
        elif not self.vehicle:
            vehicle.append(f"--save-vehicle={place / 'vehicle.toml'}")
        return ["diagnose", *logs, *vehicle, f"--report={place}", f"--json={place / 'answer.json'}", "--quiet"]
