"""The built-in vehicle's body as the physics of a real firmware.

python tests/firmware/physics.py --scenario corner --ardupilot-json 9002    # arducopter --model JSON:127.0.0.1
python tests/firmware/physics.py --scenario corner --px4-hil 4560           # px4 with PX4_SIM_MODEL=none_iris
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import ardupilot_json
import px4_hil
from body_truth import BodyTruthFile
from rough_air import AIRS
from wrong_sensors import WrongSensors

from companion.sim.scenario import NAMES, build
from companion.sim.sensors import RangeFault, RangeSensor
from companion.vehicles import TANDEM
from models.common.arguments import Parser
from models.common.errors import UserError
from models.vehicle import Vehicle, load_vehicle


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = Parser(prog="python tests/firmware/physics.py", description=(__doc__ or "").splitlines()[0])
    p.add_argument(
        "--vehicle", type=Path, default=TANDEM, help="vehicle file (default: the paper's tandem)"
    )
    p.add_argument("--scenario", choices=NAMES, default="corner")
    p.add_argument(
        "--seed",
        type=int,
        default=0,
        help="draws the air, the turbulence and every sensor's errors",
    )
    p.add_argument("--air", choices=list(AIRS), default="calm", help="see rough_air.py")
    p.add_argument("--wrong", type=Path, help="file that says which sensors are wrong from now on")
    p.add_argument("--mass-times", type=float, default=1.0, help="of the vehicle file's mass")
    p.add_argument("--speeds-port", type=int, help="UDP port that is sent rotor speeds")
    p.add_argument("--truth", type=Path, help="write what truly happened as CSV")
    firmware = p.add_mutually_exclusive_group(required=True)
    firmware.add_argument(
        "--ardupilot-json", type=int, metavar="PORT", help="UDP port (ArduPilot's is 9002)"
    )
    firmware.add_argument(
        "--px4-hil", type=int, metavar="PORT", help="TCP port to which PX4 connects (4560)"
    )
    return p


def say(**what: int) -> None:
    """One line of JSON."""
    print(json.dumps(what), flush=True)


def heavier(vehicle: Vehicle, times: float) -> Vehicle:
    """The vehicle with ``times`` its mass and inertia, and motors as they are."""
    ix, iy, iz = vehicle.inertia_kgm2
    return replace(
        vehicle,
        mass_kg=times * vehicle.mass_kg,
        inertia_kgm2=(times * ix, times * iy, times * iz),
        hover_thrust=min(0.9, times * vehicle.hover_thrust),
    )


def freeze_or_release(beam: RangeSensor) -> None:
    """What SIGUSR1 does to the first beam: it repeats itself, or works again."""
    beam.fault = None if beam.fault else RangeFault.FROZEN


def main(argv: Sequence[str] | None = None) -> int:
    """Answer until interrupted, or until PX4 leaves; returns the exit code."""
    a = parser().parse_args(argv)
    try:
        vehicle = heavier(load_vehicle(a.vehicle), a.mass_times)
        scenario = build(a.scenario, vehicle, air=a.air != "free")
        body = AIRS[a.air]
        wrong = WrongSensors(a.wrong, a.seed)
        if a.ardupilot_json is not None:
            physics = ardupilot_json.JsonPhysics(vehicle, scenario, a.seed, body, wrong=wrong)
            signal.signal(signal.SIGUSR1, lambda *_: freeze_or_release(physics.ranges[0]))
            ardupilot_json.serve(
                physics,
                a.ardupilot_json,
                lambda port: say(ardupilot_json=port),
                a.truth,
                a.speeds_port,
            )
        hil = px4_hil.Px4Physics(vehicle, scenario, a.seed, body, wrong=wrong)
        signal.signal(signal.SIGUSR1, lambda *_: freeze_or_release(hil.ranges[0]))
        truth = None if a.truth is None else BodyTruthFile(a.truth, hil.body)
        px4_hil.serve(
            hil,
            a.px4_hil,
            lambda port: say(px4_hil=port),
            truth=truth,
            speeds_port=a.speeds_port,
        )
        if truth is not None:
            truth.close()
    except UserError as error:
        print(f"physics: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
