"""One row of numbers a log, and the table of a folder."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

Row = dict[str, Any]


def row(answer: Mapping[str, Any]) -> Row:
    """Flat names with units: ``rms_before_fz_n``, ``payload.mass_kg``, ``refusal_wrong_mode_s`` …"""
    names = (
        "log",
        "date",
        "date_from",
        "vehicle",
        "system",
        "error",
        "verdict",
        "duration_s",
        "wall_s",
        "peak_mib",
    )
    out: Row = {name: answer[name] for name in names if answer.get(name) is not None}
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
        if name in answer:
            out[name] = answer[name]
    out |= {f"refusal_{reason}_s": seconds for reason, seconds in answer.get("refusals_s", {}).items()}
    for name in ("thrust", "roll_deg", "pitch_deg", "h_m", "d_m", "trust", "lift_n", "side_n"):
        out |= {f"{name}_{kind}": value for kind, value in (answer.get(name) or {}).items()}
    return {name: value for name, value in out.items() if value is not None}


def write_table(folder: Path, rows: Sequence[Row]) -> Path:
    """``table.csv``: a column a name, empty where a log lacks it."""
    target = folder / "table.csv"
    with target.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(dict.fromkeys(name for r in rows for name in r)))
        writer.writeheader()
        writer.writerows(rows)
    return target
