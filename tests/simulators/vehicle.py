"""A simulated vehicle by hand: ``python tests/simulators/vehicle.py --px4``, then ``companion --connect udpin:…``.

Its ground station arms it, takes off, and sends the companion the places of the script, again and again.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from simulated import Px4Pilot, simulated

from companion.sim.pilot import ScriptedPilot
from companion.sim.process import launch
from companion.sim.scenario import NAMES, build
from companion.vehicles import chosen_vehicle
from models.common.errors import UserError


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    p.add_argument("--scenario", choices=NAMES, default="corner")
    p.add_argument(
        "--port",
        type=int,
        default=14550,
        help="UDP port on 127.0.0.1 at which the companion listens",
    )
    p.add_argument(
        "--seed",
        type=int,
        default=0,
        help="draws the air, the turbulence and every sensor's errors",
    )
    p.add_argument("--vehicle", type=Path, help="vehicle file (default: the paper's tandem)")
    p.add_argument(
        "--px4", action="store_true", help="an autopilot like PX4 in place of ArduCopter"
    )
    p.add_argument(
        "--vision", action="store_true", help="no GPS: a position from visual odometry that drifts"
    )
    return p


def main() -> int:
    """Fly until interrupted."""
    a = parser().parse_args()
    try:
        vehicle = chosen_vehicle(a.vehicle)
        flight = simulated(vehicle, build(a.scenario, vehicle), a.seed, px4=a.px4, vision=a.vision)
        with launch(flight, Px4Pilot if a.px4 else ScriptedPilot, port=a.port) as sim:
            print(f"companion --connect {sim.endpoint}", flush=True)
            sim.process.join()
    except UserError as error:
        print(f"vehicle: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return 130
    return 1


if __name__ == "__main__":
    sys.exit(main())
