"""Options that commands share, and the configuration of the pipeline of flight that they make."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from companion.adapt_options import Adapt, read_adapt
from companion.vehicles import vehicle_path
from models.common.errors import ConfigError

if TYPE_CHECKING:
    from companion.config import PipelineConfig
    from models.choice import Choice
    from models.vehicle import Vehicle


LOG_MINUTES = 60.0
"""Most logs take seconds (docs/results.md): what takes so long hangs, or is far too long."""
EXIT_CODES = """exit codes: 0 done; 2 bad arguments, vehicle or model file; 3 log unreadable or without the needed
messages; 130 interrupted. Logs: .tlog, .BIN, .ulg."""
"""Of commands that need every log."""


def add_pipeline_options(p: argparse.ArgumentParser) -> None:
    """What a replay of the flight pipeline is given."""
    p.add_argument(
        "--vehicle",
        type=vehicle_path,
        metavar="FILE",
        help="vehicle file (default: drafted from the log)",
    )
    p.add_argument(
        "--model", metavar="DIR", help="model directory, or none (default: the shipped model)"
    )
    p.add_argument(
        "--setpoint",
        choices=("hold", "upstream"),
        default="hold",
        help="decide at every attitude (hold) or at every recorded SET_ATTITUDE_TARGET (upstream)",
    )
    p.add_argument(
        "--adapt",
        type=read_adapt,
        default=Adapt.FULL,
        metavar="off|full",
        help="full: measure the sizes of the model's effects as the flight program does (default)",
    )
    p.add_argument("--survey", metavar="BOX", help="the box of a recorded companion --survey")
    p.add_argument(
        "--param",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="take an autopilot parameter as given where the log lacks it, such as GUID_OPTIONS=8",
    )


def add_answer_options(
    p: argparse.ArgumentParser, answer: str = "the answer as JSON", flies: str = "whichever flies"
) -> None:
    """Which vehicle of a log is asked about, and where the answer goes."""
    p.add_argument(
        "--target-system", type=int, metavar="N", help=f"the vehicle's id (default: {flies})"
    )
    p.add_argument("--json", metavar="FILE", help=f"write {answer} (- for stdout)")
    p.add_argument("--quiet", action="store_true", help="no progress bar and no text")


def add_folder_options(p: argparse.ArgumentParser) -> None:
    """What only a folder of logs has."""
    g = p.add_argument_group("of a folder of logs")
    g.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="answers, table and, without --report, the page (default: NAME-COMMAND, here)",
    )
    g.add_argument(
        "--retry", action="store_true", help="ask again what failed for want of memory or time"
    )
    g.add_argument(
        "--refresh", action="store_true", help="ask again what an older version answered"
    )
    g.add_argument("--workers", type=int, metavar="N", help="local processes (default: one a core)")
    g.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT", help="a Dask cluster that sees the same files"
    )
    g.add_argument(
        "--log-minutes",
        type=float,
        metavar="M",
        help=f"give a log up after so long; --retry takes it up again (default: {LOG_MINUTES:g})",
    )
    g.add_argument(
        "--log-gb",
        type=float,
        metavar="GB",
        help="most memory for a log (default: a worker's share of the machine)",
    )


def assumed_parameters(pairs: Sequence[str]) -> dict[str, float]:
    """``NAME=VALUE`` of the command line; ConfigError where one is no number."""
    out = {}
    for pair in pairs:
        name, _, value = pair.partition("=")
        try:
            out[name] = float(value)
        except ValueError:
            out[name] = math.nan
        if not name or not math.isfinite(out[name]):
            raise ConfigError(f"--param {pair}: must be NAME=NUMBER, such as GUID_OPTIONS=8")
    return out


def pipeline_config(
    a: argparse.Namespace, flown: tuple[Vehicle, Choice]
) -> tuple[PipelineConfig, Choice, list[str]]:
    """What does not change over the log, the model that was chosen, and what is to be said about model and vehicle.

    ``flown``: the vehicle, and the model for it.
    """
    # Imported here so that --help answers at once.
    from companion.config import Base, PipelineConfig
    from companion.survey_box import read_box
    from models.vehicle.plausibility import warnings

    vehicle, chosen = flown
    config = PipelineConfig(
        vehicle=vehicle,
        model=chosen.model,
        base=Base.HOLD if a.setpoint == "hold" else Base.UPSTREAM,
        dry_run=True,
        survey=None if a.survey is None else read_box(a.survey),
        adapt=a.adapt,
    )
    notes = [
        *([chosen.note] if chosen.note else []),
        *(
            f"the model is of another fan than the vehicle file: {wrong}"
            for wrong in chosen.contradictions
        ),
        *(f"vehicle file: {line}" for line in warnings(vehicle)),
    ]
    return config, chosen, notes
