"""Logs below a folder, their answers on disk, one file a log, and the table of all."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from models.errors import LogError
from models.pages.document import write_document
from replay.fleet.jobs import Job
from replay.logs.formats import READERS


def logs_in(folder: Path) -> tuple[list[Path], list[str]]:
    """Every log below a folder in order of name, and a line for what looks like one and cannot be read."""
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    found = [p for p in files if p.suffix.lower() in READERS]
    packed = [p for p in files if p not in found and len(p.suffixes) > 1 and p.suffixes[-2].lower() in READERS]
    notes = [f"{p}: is compressed: unpack it first" for p in packed]
    if not found:
        known = ", ".join(READERS)
        raise LogError(f"{folder}: holds no log ({known}){'; ' + notes[0] if notes else ''}")
    return found, notes


def known(out: Path, job: Job) -> dict[str, Any] | None:
    """The answer of an earlier run to exactly this question; None where it, or the page that goes with it, is gone."""
    try:
        answer: dict[str, Any] = json.loads(_file(out, job).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return answer if "error" in answer or job.page is None or job.page.is_file() else None


def keep(out: Path, job: Job, answer: dict[str, Any]) -> None:
    """Write an answer; an interruption leaves the whole file or none. Raises ConfigError."""
    target = _file(out, job)
    part = write_document("--out", target.with_suffix(".part"), json.dumps(answer, indent=1, allow_nan=False) + "\n")
    os.replace(part, target)


def _file(out: Path, job: Job) -> Path:
    return out / "results" / f"{job.name}.json"


def row(answer: Mapping[str, Any]) -> dict[str, Any]:
    """Flat names with units: ``rms_before_fz_n``, ``payload.mass_kg``, ``refusal_wrong_mode_s`` …"""
    names = ("log", "date", "date_from", "error", "verdict", "duration_s", "wall_s")
    out = {name: answer.get(name) for name in names}
    for axis, numbers in answer.get("axes", {}).items():
        unit = "n" if numbers["unit"] == "N" else "nm"
        out[f"rms_before_{axis.lower()}_{unit}"] = numbers["rms_before"]
        out[f"rms_after_{axis.lower()}_{unit}"] = numbers["rms_after"]
    for effect in answer.get("effects", []):
        name = effect["name"]
        out[f"{name}.explains"] = effect.get("explains")
        out[f"{name}.probability"] = effect.get("probability")
        for parameter, estimate in effect["parameters"].items():
            low, high = estimate.get("ci95") or (None, None)
            out[f"{name}.{parameter}"] = estimate["value"]
            out[f"{name}.{parameter}.low"], out[f"{name}.{parameter}.high"] = low, high
    for name in ("decisions", "commands", "compensated_s", "share_compensated", "gaps_s"):
        out[name] = answer.get(name)
    out |= {f"refusal_{reason}_s": seconds for reason, seconds in answer.get("refusals_s", {}).items()}
    for name in ("thrust", "roll_deg", "pitch_deg", "h_m", "d_m", "trust", "lift_n", "side_n"):
        out |= {f"{name}_{kind}": value for kind, value in (answer.get(name) or {}).items()}
    return {name: value for name, value in out.items() if value is not None}


def table(answers: Sequence[Mapping[str, Any]]) -> str:
    """As CSV: a row a log, a column a name, empty where a log lacks it."""
    rows = [row(answer) for answer in answers]
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(dict.fromkeys(name for r in rows for name in r)), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
