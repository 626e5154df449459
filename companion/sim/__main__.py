"""``python -m companion.sim``: the built-in vehicle as a process of its own."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from companion.sim.flight import Flight
from companion.sim.pilot import Recipient
from companion.sim.process import Options, run
from companion.sim.scenario import NAMES, build
from companion.vehicles import TANDEM
from models.arguments import Parser
from models.errors import ConfigError, UserError
from models.vehicle import load_vehicle


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = Parser(prog="python -m companion.sim", description=__doc__)
    p.add_argument("--scenario", choices=NAMES, default="corner")
    p.add_argument("--port", type=int, default=14550, help="UDP port on 127.0.0.1 at which the companion listens")
    p.add_argument("--seed", type=int, default=0, help="draws the air, the turbulence and every sensor's errors")
    p.add_argument("--speed", type=float, default=1.0, help="simulated seconds per second")
    p.add_argument(
        "--pilot", choices=[h.value for h in Recipient], default=Recipient.COMPANION.value, help="who gets the script"
    )
    p.add_argument("--truth", type=Path, help="write what truly happened as CSV; ends when the script ends")
    p.add_argument("--duration", type=float, help="boot seconds after which to end")
    p.add_argument("--vehicle", type=Path, default=TANDEM, help="vehicle file (default: the paper's tandem)")
    p.add_argument("--px4", action="store_true", help="speak PX4's dialect: OFFBOARD, ESC_STATUS")
    p.add_argument("--vision", action="store_true", help="no GPS: a position from visual odometry that drifts")
    p.add_argument("--narrate", action="store_true", help="print every phase of the script, and its end, as JSON")
    p.add_argument("--until-stdin-closes", action="store_true", help="end when the parent process ends")
    return p


def _check(a: argparse.Namespace) -> None:
    if not 1 <= a.port <= 65535:
        raise ConfigError(f"--port {a.port}: must be 1 to 65535")
    for name, value in (("--speed", a.speed), ("--duration", a.duration)):
        if value is not None and not 0.0 < value < float("inf"):
            raise ConfigError(f"{name} {value:g}: must be a positive number")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the simulator; returns the exit code."""
    a = parser().parse_args(argv)
    try:
        _check(a)
        vehicle = load_vehicle(a.vehicle)
        flight = Flight(vehicle, build(a.scenario, vehicle), a.seed, px4=a.px4, vision=a.vision)
        run(
            flight,
            Options(a.port, a.speed, Recipient(a.pilot), a.truth, a.duration, a.until_stdin_closes, a.narrate),
        )
    except UserError as error:
        print(f"companion.sim: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
