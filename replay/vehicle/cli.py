"""``replay vehicle``: arguments and output; the work is in fit.py."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from companion.vehicles import vehicle_path

_EPILOG = """exit codes: 0 done; 2 bad arguments or vehicle file; 3 log unreadable, or too little hover in it; 130
interrupted. Every key of a vehicle file: docs/vehicle.md."""


def add_parser(commands: Any) -> None:
    """Register ``vehicle`` with the subparsers of ``replay``."""
    p: argparse.ArgumentParser = commands.add_parser(
        "vehicle", help="measure thrust and hover of the vehicle file in logs of a hover", epilog=_EPILOG,
        description="Measures ct (or the [throttle] curve) and hover_thrust where logs show a free hover.",
    )  # fmt: skip
    p.add_argument("logs", nargs="+", type=Path, metavar="LOG", help=".tlog, .BIN or .ulg of one vehicle")
    p.add_argument("--vehicle", type=vehicle_path, required=True, metavar="FILE", help="vehicle file to begin with")
    p.add_argument("--out", type=Path, metavar="FILE.toml", help="write the vehicle file with the measured numbers")
    p.add_argument("--target-system", type=int, metavar="N", help="the vehicle's id (default: whichever flies)")
    p.add_argument("--json", metavar="FILE", help="write the numbers as JSON (- for stdout)")
    p.add_argument("--quiet", action="store_true", help="no text")
    p.set_defaults(run=run)


def run(a: argparse.Namespace) -> int:
    """Run the command; UserErrors are reported by the caller."""
    from models.json_file import write_json
    from models.text_file import write_text
    from models.vehicle import load_vehicle, parse_vehicle
    from models.vehicle_plausibility import warnings
    from models.vehicle_setup.toml_text import vehicle_text
    from replay.vehicle.fit import fit

    found = fit(a.logs, load_vehicle(a.vehicle), a.target_system)
    origin = {e.key: f"measured in {', '.join(p.name for p in a.logs)}" for e in found.estimates}
    text = vehicle_text(found.vehicle, origin, "Every key: docs/vehicle.md. SI units, body FRD.")
    checked = parse_vehicle(text, str(a.out or a.vehicle))
    if a.out is not None:
        write_text("--out", a.out, text)
    if a.json is not None:
        numbers = {e.key: e.as_json() for e in found.estimates}
        write_json({"hover_s": round(found.hover_s, 3), "vehicle": numbers, "notes": list(found.notes)}, a.json)
    if a.json != "-" and not a.quiet:
        print(f"{found.hover_s:.0f} s of free hover")
        for estimate in found.estimates:
            print(estimate.as_text())
        for line in (*found.notes, *warnings(checked)):
            print(f"  note: {line}")
        print(f"written: {a.out}" if a.out is not None else "nothing written: --out FILE.toml writes the vehicle file")
    return 0
