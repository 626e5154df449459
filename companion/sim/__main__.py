"""``python -m companion.sim``: the built-in vehicle as a process of its own."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

from companion.sim.ardupilot_json import JsonPhysics, serve
from companion.sim.body_truth import BodyTruthFile
from companion.sim.pilot import Hand
from companion.sim.process import Options, run
from companion.sim.px4_hil import Px4Physics
from companion.sim.px4_hil import serve as serve_px4
from companion.sim.scenario import NAMES, build
from models.arguments import Parser
from models.errors import ConfigError, UserError
from models.vehicle import Vehicle, load_vehicle


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = Parser(prog="python -m companion.sim", description=__doc__)
    p.add_argument("--scenario", choices=NAMES, default="corner")
    p.add_argument("--port", type=int, default=14550, help="UDP port on 127.0.0.1 at which the companion listens")
    p.add_argument("--seed", type=int, default=0, help="draws the air, the turbulence and every sensor's errors")
    p.add_argument("--speed", type=float, default=1.0, help="simulated seconds per second")
    p.add_argument("--air", choices=("corner", "free"), default="corner", help="free: obstacles without their air")
    p.add_argument("--pilot", choices=[h.value for h in Hand], default=Hand.COMPANION.value, help="who gets the script")
    p.add_argument("--truth", type=Path, help="write what truly happened as CSV; ends when the script ends")
    p.add_argument("--duration", type=float, help="boot seconds after which to end")
    p.add_argument("--vehicle", type=Path, help="vehicle file (default: the paper's tandem)")
    p.add_argument("--px4", action="store_true", help="speak PX4's dialect: OFFBOARD, ESC_STATUS")
    p.add_argument(
        "--ardupilot-json",
        type=int,
        metavar="PORT",
        help="instead, answer ArduPilot's JSON physics protocol on this UDP port (theirs is 9002)",
    )
    p.add_argument(
        "--px4-hil",
        type=int,
        metavar="PORT",
        help="instead, be the simulator that PX4 connects to on this TCP port (theirs is 4560), in lockstep",
    )
    p.add_argument("--narrate", action="store_true", help="print every phase of the script, and its end, as JSON")
    p.add_argument("--until-stdin-closes", action="store_true", help="end when the parent process ends")
    return p


def _check(a: argparse.Namespace) -> None:
    if not 1 <= a.port <= 65535:
        raise ConfigError(f"--port {a.port}: must be 1 to 65535")
    for name, value in (("--speed", a.speed), ("--duration", a.duration)):
        if value is not None and not 0.0 < value < float("inf"):
            raise ConfigError(f"{name} {value:g}: must be a positive number")


def _say(**what: int) -> None:
    print(json.dumps(what), flush=True)


def _px4_hil(a: argparse.Namespace, vehicle: Vehicle) -> int:
    physics = Px4Physics(vehicle, build(a.scenario, vehicle, air=a.air == "corner"), a.seed)
    truth = None if a.truth is None else BodyTruthFile(a.truth, physics.body)
    serve_px4(physics, a.px4_hil, lambda port: _say(px4_hil=port), speed=a.speed, duration_s=a.duration, truth=truth)
    if truth is not None:
        truth.close()
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the simulator; returns the exit code."""
    a = parser().parse_args(argv)
    path = a.vehicle or Path(str(resources.files("companion") / "vehicles" / "tandem.toml"))
    try:
        _check(a)
        vehicle = load_vehicle(path)
        if a.ardupilot_json is not None:
            physics = JsonPhysics(vehicle, build(a.scenario, vehicle, air=a.air == "corner"), a.seed)
            serve(physics, a.ardupilot_json, lambda port: _say(ardupilot_json=port), a.truth)
        if a.px4_hil is not None:
            return _px4_hil(a, vehicle)
        return run(
            Options(
                vehicle=vehicle,
                scenario=a.scenario,
                port=a.port,
                seed=a.seed,
                speed=a.speed,
                air=a.air == "corner",
                hand=Hand(a.pilot),
                truth=a.truth,
                duration_s=a.duration,
                px4=a.px4,
                until_stdin_closes=a.until_stdin_closes,
                narrate=a.narrate,
            )
        )
    except UserError as error:
        print(f"companion.sim: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
