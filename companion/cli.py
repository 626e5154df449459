"""``companion``: argument parsing and exit codes; nothing else."""

from __future__ import annotations

import argparse
import gc
import logging
import math
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from companion.adapt_options import Adapt, read_adapt
from companion.mavlink import BAUD
from companion.vehicles import vehicle_path
from models.common.arguments import INTERRUPTED, Parser, VersionAction, speaks
from models.common.errors import ConfigError, LinkError, UserError
from models.common.text_file import write_json

if TYPE_CHECKING:
    from companion.config import PipelineConfig
    from companion.flight.loop import Flight
    from companion.mavlink.link import Arrivals, Link
    from companion.sim.process import SimProcess
    from models.vehicle import Vehicle

_NO_VEHICLE = (
    "no --vehicle: nothing is sent. Name the vehicle's file; the paper's tandem is --vehicle tandem"
)
_EPILOG = """exit codes: 0 done; 1 --check found a fault; 2 bad arguments, vehicle or model file; 3 log unreadable;
4 link could not be opened, or no autopilot was heard on it; 130 interrupted. It never arms or changes the mode."""


def parser() -> argparse.ArgumentParser:
    """The command line of ``companion``."""
    p = Parser(
        prog="companion",
        description="Compensate the disturbance by ground, wall and corner on a hovering vehicle, "
        "over MAVLink.",
        epilog=_EPILOG,
    )
    p.add_argument("--version", action=VersionAction, nargs=0, help="print the version and exit")
    p.add_argument(
        "--connect",
        metavar="ENDPOINT",
        help="udp:0.0.0.0:14550, udpin:…, udpout:…, tcp:HOST:PORT, /dev/ttyAMA0, or sim:corner "
        "(built-in vehicle)",
    )
    p.add_argument("--baud", type=int, default=BAUD, help=f"of a serial port (default {BAUD})")
    p.add_argument(
        "--vehicle",
        type=vehicle_path,
        metavar="FILE.toml",
        help="vehicle file, or the name of one that ships: tandem, quad; without one sim: flies "
        "the tandem, and to a real link nothing is sent",
    )
    p.add_argument(
        "--model",
        metavar="DIR",
        help="model directory, or none: no offsets (default: the shipped model, and none for a "
        "vehicle with another fan)",
    )
    p.add_argument(
        "--check",
        nargs="?",
        const=True,
        metavar="FLIGHT.tlog",
        help="listen for ten seconds, or read a log, and say per item whether to fly and what to "
        "set; sends no setpoint",
    )
    p.add_argument("--dry-run", action="store_true", help="compute and report, send no setpoint")
    _add_flight_options(p)
    _add_trial_options(p)
    return p


def _add_flight_options(p: Parser) -> None:
    """How a flight goes, and what is kept of it."""
    p.add_argument(
        "--setpoint",
        default="hold",
        metavar="hold|ENDPOINT",
        help="hold: built-in hold where it engaged; or an endpoint on which an upstream "
        "controller sends SET_ATTITUDE_TARGET, forwarded with the offset added",
    )
    p.add_argument(
        "--carrier",
        choices=("attitude", "acceleration"),
        default="attitude",
        help="how offsets travel; acceleration is for PX4",
    )
    p.add_argument(
        "--record",
        type=Path,
        metavar="FILE.tlog",
        help="record both directions of the link; a folder, or a name with {date} and {boot}, is "
        "filled in; no file is ever overwritten: -2, -3 ... is added to the name",
    )
    p.add_argument(
        "--page",
        metavar="[HOST]:PORT",
        help="serve a live page, :8080 for this machine, 0.0.0.0:8080 for the network",
    )
    p.add_argument(
        "--survey",
        metavar="BOX",
        help="move the hold slowly through HEIGHT_MIN:HEIGHT_MAX[:WALL_MIN:WALL_MAX] metres and "
        "back, to learn ground and wall from the recording; another mode or target ends it",
    )
    p.add_argument(
        "--adapt",
        type=read_adapt,
        metavar="off|full",
        help="full: measure the sizes of the model's effects in flight and compensate by them, "
        "up to 1.5 of the model (default: full; off with --compare)",
    )
    p.add_argument("--duration", type=float, metavar="S", help="stop after this many seconds")
    p.add_argument(
        "--signing-key",
        type=Path,
        metavar="FILE",
        help="MAVLink 2 signing key: 32 bytes or 64 hex digits",
    )
    p.add_argument(
        "--target-system",
        type=int,
        metavar="N",
        help="the vehicle's system id (default: the first heard)",
    )


def _add_trial_options(p: Parser) -> None:
    """Of the built-in vehicle, and of the report."""
    p.add_argument("--no-offsets", action="store_true", help="fly the bare hold, for comparison")
    p.add_argument(
        "--compare",
        action="store_true",
        help="with sim:NAME: fly the approach with and without offsets, in free air, by the "
        "autopilot, and print the errors; with --adapt full three approaches in each flight; "
        "--record takes the flight without offsets",
    )
    p.add_argument(
        "--plot",
        type=Path,
        metavar="FILE.svg",
        help="with --compare: draw the errors over the script",
    )
    p.add_argument("--seed", type=int, default=0, help="of the built-in vehicle")
    p.add_argument("--json", metavar="FILE", help="write the report as JSON (- for stdout)")
    p.add_argument("--quiet", action="store_true", help="no progress, no state changes on stderr")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    arguments = parser().parse_args(argv)
    try:
        _check(arguments)
        if arguments.check is not None:
            return _preflight(arguments)
        if arguments.compare:
            return _compare(arguments)
        return _fly(arguments)
    except UserError as error:
        print(f"companion: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our report left
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def scenario_name(endpoint: str) -> str:
    """The flight that ``sim:NAME`` names; ``sim:`` alone is the corner."""
    return endpoint.removeprefix("sim:") or "corner"


def _check(a: argparse.Namespace) -> None:
    """Refuse arguments that are wrong, or that cannot be had beside each other."""
    needs = (
        (
            "--connect",
            a.connect is None and not isinstance(a.check, str),
            "an endpoint, such as udp:0.0.0.0:14550",
        ),
        (
            "--duration",
            a.duration is not None and not 0.0 < a.duration < math.inf,
            "a positive number of seconds",
        ),
        (
            "--target-system",
            a.target_system is not None and not 1 <= a.target_system <= 255,
            "1 to 255",
        ),
        ("--compare", a.compare and not _simulated(a), "--connect sim:NAME"),
        ("--plot", a.plot is not None and not a.compare, "--compare"),
        ("--survey", a.survey is not None and a.record is None, "--record"),
        (
            "--survey",
            a.survey is not None and (a.dry_run or a.setpoint != "hold"),
            "--setpoint hold, sent",
        ),
        ("--carrier", a.carrier != "attitude" and a.setpoint != "hold", "--setpoint hold"),
        ("--check FILE.tlog", isinstance(a.check, str) and a.connect is not None, "no --connect"),
        ("--check", a.check is not None and a.compare, "no --compare"),
        ("--connect sim:NAME", _simulated(a) and a.signing_key is not None, "no --signing-key"),
    )
    for option, missed, need in needs:
        if missed:
            raise ConfigError(f"{option}: needs {need}")
    if _simulated(a):
        from companion.sim.world import check_scenario

        check_scenario(scenario_name(a.connect))


def _simulated(a: argparse.Namespace) -> bool:
    return a.connect is not None and a.connect.startswith("sim:")


def _preflight(a: argparse.Namespace) -> int:
    """``--check``: a dry run that is looked at, or a log."""
    # Imported here so that --help answers at once.
    from companion import check
    from companion.flight.loop import Flight
    from companion.flight.options import FlightOptions
    from companion.mavlink.link import Arrivals

    flown, note = _config(a)
    config = replace(flown, dry_run=True, survey=None, adapt=Adapt.OFF)
    listener = check.Listener(config=config, system=a.target_system)
    if a.check is not True:
        log = a.check
    elif a.connect.endswith(".tlog"):
        log = a.connect
    else:
        log = None
    if log is not None:
        check.read_log(Path(log), listener)
    else:
        with ExitStack() as stack:
            arrivals = Arrivals()
            link, _ = _open(a, config.vehicle, stack, arrivals)
            options = FlightOptions(
                duration_s=a.duration or check.LISTEN_S, target_system=a.target_system
            )
            if not a.quiet and sys.stderr.isatty():
                print(f"companion: listening for {options.duration_s:g} s", file=sys.stderr)
            flight = Flight(
                config=config,
                link=link,
                recorder=listener,
                arrivals=arrivals,
                options=options,
            )
            flight.run()
    if a.vehicle is None:
        name = "default vehicle"
    else:
        name = str(a.vehicle)
    setup = check.CheckSetup(
        config=config,
        vehicle_file=name,
        model_note=note,
        adapts=flown.adapt is not Adapt.OFF,
        record=a.record,
        signed=a.signing_key is not None,
        live=log is None,
    )
    found = check.items(listener, setup)
    if a.json is not None:
        write_json(check.as_json(found), a.json)
    if speaks(a):
        print(check.as_text(found))
    if check.may_fly(found):
        return 0
    if setup.live and check.silent(listener):
        return LinkError.exit_code
    return 1


def _fly(a: argparse.Namespace) -> int:
    # Imported here so that --help answers at once.
    from companion.config import Base
    from companion.flight.loop import Flight
    from companion.flight.options import FlightOptions
    from companion.mavlink.link import Arrivals, open_link
    from companion.mavlink.tlog_writer import Recorder
    from companion.page.feed import PageFeed, read_address
    from companion.watchdog import Watchdog
    from models.vehicle.plausibility import warnings

    config, note = _config(a)
    notes = [note, *(f"{a.vehicle}: {warning}" for warning in warnings(config.vehicle))]
    if a.vehicle is None and not _simulated(a):
        config = replace(config, dry_run=True)
        notes.insert(1, _NO_VEHICLE)
    arrivals = Arrivals()
    with ExitStack() as stack:
        _log_to_stderr(a, stack)
        link, sim = _open(a, config.vehicle, stack, arrivals)
        upstream = page = None
        if config.base is Base.UPSTREAM:
            upstream = stack.enter_context(
                closing(open_link(a.setpoint, arrivals, baud=a.baud, number=1))
            )
        if a.record is None:
            recorder = None
        else:
            recorder = stack.enter_context(closing(Recorder(a.record)))
        watchdog = stack.enter_context(closing(Watchdog()))
        if a.page is not None:
            page = stack.enter_context(closing(PageFeed(*read_address(a.page))))
            notes.append(f"live page at {page.url}")
        options = FlightOptions(
            duration_s=a.duration,
            target_system=a.target_system,
            last_word=True,
            watchdog=watchdog,
            page=page,
        )
        # After all that may refuse, so that a refusal is one line.
        if not a.quiet:
            for line in filter(None, notes):
                print(f"companion: {line}", file=sys.stderr)
        flight = Flight(
            config=config,
            link=link,
            upstream=upstream,
            recorder=recorder,
            arrivals=arrivals,
            options=options,
        )
        if sim is not None and a.duration is None:
            _follow(sim, flight, quiet=a.quiet)
        interrupted = _run(flight)
        _tell(flight, a)
        heard = flight.unheard is None
    if interrupted:
        return INTERRUPTED
    if heard:
        return 0
    return LinkError.exit_code


def _follow(sim: SimProcess, flight: Flight, *, quiet: bool) -> None:
    """Say what the built-in vehicle's flight says, and end with it."""
    from companion.sim.process import follow

    def say(text: str) -> None:
        if not quiet:
            print(text, file=sys.stderr, flush=True)

    follow(sim.news, say, flight.stop)


def _tell(flight: Flight, a: argparse.Namespace) -> None:
    """What the flight was, as JSON or as text, and why nothing was heard."""
    if a.json is not None:
        write_json(flight.as_json(), a.json)
    elif not a.quiet:
        print(flight.summary.as_text())
    if flight.unheard is not None:
        print(f"companion: {a.connect}: {flight.unheard}", file=sys.stderr)


def _log_to_stderr(a: argparse.Namespace, stack: ExitStack) -> None:
    """What the flight program logs are lines for the pilot."""
    log = logging.getLogger("companion")
    shown = logging.StreamHandler()
    log.setLevel(logging.WARNING if a.quiet else logging.INFO)
    log.addHandler(shown)
    stack.callback(log.removeHandler, shown)


def _config(a: argparse.Namespace) -> tuple[PipelineConfig, str | None]:
    """What does not change during the flight, and what is to be said about the model."""
    from companion.config import Base, Carrier, PipelineConfig
    from companion.survey_box import read_box
    from companion.vehicles import chosen_vehicle
    from models.choice import choose_to_fly

    default = None
    if _simulated(a):
        from companion.sim.world import default_model

        default = default_model(scenario_name(a.connect))
    vehicle = chosen_vehicle(a.vehicle)
    chosen = choose_to_fly(vehicle, a.model, default)
    config = PipelineConfig(
        vehicle=vehicle,
        model=chosen.model,
        base=Base.HOLD if a.setpoint == "hold" else Base.UPSTREAM,
        carrier=Carrier(a.carrier),
        dry_run=a.dry_run,
        offsets=not a.no_offsets,
        survey=None if a.survey is None else read_box(a.survey),
        adapt=a.adapt or Adapt.FULL,
    )
    return config, chosen.note


def _open(
    a: argparse.Namespace, vehicle: Vehicle, stack: ExitStack, arrivals: Arrivals
) -> tuple[Link, SimProcess | None]:
    """The link, and the built-in vehicle where that flies."""
    from companion.mavlink.link import open_link, read_signing_key

    if a.signing_key is None:
        key = None
    else:
        key = read_signing_key(a.signing_key)
    endpoint = a.connect
    sim = None
    if _simulated(a):
        from companion.sim.flight import SimulatedFlight
        from companion.sim.process import launch
        from companion.sim.scenario import build

        sim = stack.enter_context(
            launch(SimulatedFlight(vehicle, build(scenario_name(a.connect), vehicle), a.seed))
        )
        endpoint = sim.endpoint
    return stack.enter_context(
        closing(open_link(endpoint, arrivals, baud=a.baud, signing_key=key))
    ), sim


def _run(flight: Flight) -> bool:
    """Fly until the end; returns whether a signal asked for it."""
    interrupted = False

    def interrupt(*_: object) -> None:
        nonlocal interrupted
        interrupted = True
        flight.stop()

    signal.signal(signal.SIGINT, interrupt)
    signal.signal(signal.SIGTERM, interrupt)
    # What was loaded stays for the whole flight: the collector need not look at it at every pass.
    gc.collect()
    gc.freeze()
    flight.run()
    return interrupted


def _compare(a: argparse.Namespace) -> int:
    from companion.sim.compare import CompareSettings, compare, write

    settings = CompareSettings(
        scenario=scenario_name(a.connect),
        vehicle=a.vehicle,
        model=a.model,
        adapt=a.adapt or Adapt.OFF,
        record=a.record,
    )
    if settings.choice.note is not None and not a.quiet:
        print(f"companion: {settings.choice.note}", file=sys.stderr)
    write(compare([a.seed], settings, quiet=a.quiet), json_path=a.json, plot=a.plot)
    return 0
