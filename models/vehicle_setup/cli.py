"""``models vehicle``: options, and a checked file."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from models.errors import ConfigError
from models.text_file import write_text
from models.vehicle_setup.frames import FRAMES, ardupilot_frame, px4_motors

_EPILOG = """Every key: docs/vehicle.md. Who has a log of the vehicle needs none of this: `replay diagnose LOG
--save-vehicle FILE` drafts the file. Afterwards `replay vehicle LOG --vehicle FILE` measures thrust and hover."""
_MOST = {
    "mass": 1e4, "span": 20.0, "propeller": 200.0, "duct": 10.0, "hover_rpm": 2e5, "voltage": 1e3, "hover_thrust": 1.0,
}  # fmt: skip
"""Largest believable numbers by option; all are above 0."""


def add(commands: Any) -> None:
    """Register ``vehicle`` with the subparsers of ``models``."""
    p: argparse.ArgumentParser = commands.add_parser(
        "vehicle", help="write a vehicle file from a frame, a mass and a few lengths", epilog=_EPILOG,
        description="A vehicle file from options and the autopilot's parameters.",
    )  # fmt: skip
    p.add_argument("--out", type=Path, required=True, metavar="FILE.toml", help="file to write")
    p.add_argument(
        "--params", type=Path, metavar="FILE", help="parameters as Mission Planner or QGroundControl save them"
    )
    p.add_argument("--name", metavar="TEXT", help="what the vehicle is called")
    p.add_argument("--frame", choices=FRAMES, help="motors by ArduPilot's numbers (default: as --params say)")
    p.add_argument("--mass", type=float, metavar="KG", help="ready to fly, with battery")
    p.add_argument("--span", type=float, metavar="M", help="diagonal: motor axis to the opposite motor's axis")
    p.add_argument("--propeller", type=float, metavar="INCH", help="diameter")
    p.add_argument("--duct", type=float, metavar="M", help="outer radius of the duct (default: open rotors)")
    p.add_argument("--rotor-height", type=float, default=0.05, metavar="M", help="of the rotors over the CG (0.05)")
    p.add_argument("--no-rpm", action="store_true", help="no rotor speed is telemetered: thrust from servo outputs")
    p.add_argument("--hover-thrust", type=float, metavar="SHARE", help="throttle in hover, 0 to 1")
    p.add_argument("--hover-rpm", type=float, metavar="RPM", help="rotor speed in hover: gives ct")
    p.add_argument("--voltage", type=float, metavar="V", help="of the battery in hover; needed with --no-rpm")
    p.add_argument("--range", action="append", default=[], metavar="ORIENTATION:X,Y,Z",
                   help="a rangefinder: 25 down, 24 up, 0 ahead, 2 right, 4 back, 6 left; and where it sits "
                   "from the CG, forward right down [m]")  # fmt: skip
    p.add_argument("--force", action="store_true", help="overwrite FILE.toml")
    p.add_argument("--quiet", action="store_true", help="no text")
    p.set_defaults(run=run)


def run(a: argparse.Namespace) -> int:
    """Ask, build, check, write. Raises ConfigError in one line; nothing is written then."""
    from models.vehicle import parse_vehicle
    from models.vehicle_plausibility import warnings
    from models.vehicle_setup.parameters import read_parameters
    from models.vehicle_setup.setup import build
    from models.vehicle_setup.toml_text import vehicle_text

    if a.out.exists() and not a.force:
        raise ConfigError(f"--out {a.out}: is there already; --force overwrites it")
    parameters = {} if a.params is None else read_parameters(a.params)
    given = _complete(vars(a), parameters)
    vehicle, origin = build(_answers(given, parameters))
    text = vehicle_text(vehicle, origin, "Written by models vehicle. Every key: docs/vehicle.md. SI units, body FRD.")
    checked = parse_vehicle(text, str(a.out))
    write_text("--out", a.out, text)
    if not a.quiet:
        print(f"{a.out}: {len(checked.fans)} fans, {len(checked.rotors)} rotors, checked")
        for line in warnings(checked):
            print(f"  note: {line}")
        print(f"next: hover for a minute, then: replay vehicle LOG --vehicle {a.out} --out {a.out}")
    return 0


def _complete(given: Mapping[str, Any], parameters: Mapping[str, float]) -> dict[str, Any]:
    """The options, with the frame that the parameters say; ConfigError naming all that is missing."""
    out = dict(given)
    placed = out["frame"] is None and px4_motors(parameters) is not None
    if out["frame"] is None:
        out["frame"] = ardupilot_frame(parameters)
    if out["name"] is None:
        out["name"] = Path(out["out"]).stem
    needed = ["mass", *([] if placed else ["frame", "span"]), "propeller", *(["voltage"] if out["no_rpm"] else [])]
    missing = [f"--{option}" for option in needed if out[option] is None]
    if missing:
        raise ConfigError(f"{', '.join(missing)}: needed")
    return out


def _answers(g: Mapping[str, Any], parameters: Mapping[str, float]) -> Any:
    from models.vehicle_setup.setup import Answers

    for option, high in _MOST.items():
        value = g[option]
        if value is not None and not 0.0 < value <= high:
            raise ConfigError(f"--{option.replace('_', '-')} {value:g}: must be above 0 and at most {high:g}")
    placed = px4_motors(parameters) if g["frame"] is None else None
    motors, arm_m = placed or (FRAMES[g["frame"]], 0.0)
    return Answers(
        name=g["name"],
        mass_kg=g["mass"],
        propeller_m=g["propeller"] * 0.0254,
        motors=motors,
        arm_m=arm_m if g["span"] is None else g["span"] / 2.0,
        rotor_down_m=-g["rotor_height"],
        lip_radius_m=g["duct"],
        telemetered=not g["no_rpm"],
        hover_thrust=g["hover_thrust"],
        hover_rpm=g["hover_rpm"],
        voltage_v=g["voltage"] or 0.0,
        ranges=tuple(_range(text) for text in g["range"]),
        parameters=parameters,
    )


def _range(text: str) -> Any:
    from models.vehicle import Rangefinder
    from models.vehicle_setup.setup import target_of

    head, _, tail = text.partition(":")
    try:
        x, y, z = (float(v) for v in tail.split(","))
        return Rangefinder(int(head), target_of(int(head)), (x, y, z))
    except ValueError:
        raise ConfigError(f"--range {text}: must be ORIENTATION:X,Y,Z, such as 25:0,0,0.05") from None
