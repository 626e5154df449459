"""``replay diagnose``: arguments, files and text; the work is in diagnose.py."""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from models.errors import ConfigError
from replay.fleet.options import add_options

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from models.surrogate.fan_surrogate import FanSurrogate
    from models.vehicle import Vehicle
    from replay.diagnosis.diagnose import Diagnosis
    from replay.predict.predict import Prediction
    from replay.vehicle.draft import Draft

_EPILOG = """exit codes: 0 done; 2 bad arguments, vehicle or model file; 3 log unreadable or without the needed
messages; 130 interrupted. Logs: .tlog, .BIN, .ulg. How to read the answer: docs/diagnose.md."""


def add_parser(commands: Any) -> None:
    """Register ``diagnose`` with the subparsers of ``replay``."""
    p: argparse.ArgumentParser = commands.add_parser(
        "diagnose", help="find what the declared model lacks, name it, and amend the model", epilog=_EPILOG,
        description="Measured minus modelled wrench of recorded flights: which physical effect is missing, how large "
        "it is, and the error before and after adding it, on time that the fit never saw.",
    )  # fmt: skip
    p.add_argument(
        "logs",
        nargs="+",
        type=Path,
        metavar="LOG",
        help=".tlog, .BIN or .ulg; several confirm each other; a folder: each by itself",
    )
    p.add_argument("--vehicle", type=Path, metavar="FILE.toml", help="vehicle file (default: drafted from the logs)")
    p.add_argument("--mass", type=float, metavar="KG", help="of the drafted vehicle, with battery (default: typical)")
    p.add_argument("--propeller", type=float, metavar="INCH", help="diameter (default: typical)")
    p.add_argument(
        "--span", type=float, metavar="M", help="motor axis to the opposite motor's axis (default: no moments)"
    )
    p.add_argument("--save-vehicle", type=Path, metavar="FILE.toml", help="write the drafted vehicle for --vehicle")
    p.add_argument(
        "--model", metavar="DIR", help="declared model, or none: rotors in free air (default: the shipped model)"
    )
    p.add_argument("--save-model", type=Path, metavar="DIR", help="write the amended model; companion --model flies it")
    p.add_argument(
        "--test", nargs="+", type=Path, default=[], metavar="LOG",
        help="other flights, on which the amended model is judged as replay predict does",
    )  # fmt: skip
    p.add_argument(
        "--report", type=Path, metavar="DIR", help="write a self-contained HTML page; for a folder, of each log"
    )
    p.add_argument(
        "--since", nargs="+", metavar="GOOD",
        help="good flights of the vehicle: name only what changed since (with a folder: how many of its first logs)",
    )  # fmt: skip
    p.add_argument("--target-system", type=int, metavar="N", help="the vehicle's id (default: whichever flies)")
    p.add_argument("--seed", type=int, default=0, metavar="N", help="of the null draws and the bootstrap (default 0)")
    p.add_argument("--json", metavar="FILE", help="write the answer as JSON (- for stdout)")
    p.add_argument("--quiet", action="store_true", help="no progress bar and no text")
    add_options(p)
    p.set_defaults(run=run)


def run(a: argparse.Namespace) -> int:
    """Run the command; UserErrors are reported by the caller."""
    _check_arguments(a)
    if a.since:
        from replay.changes.cli import run as run_since

        return run_since(a, progress_bar(a))
    if any(log.is_dir() for log in a.logs):
        return _folder(a)
    # Imported here so that --help answers at once.
    from models.vehicle_plausibility import warnings
    from models.vehicle_setup.toml_text import write_vehicle
    from replay.command import given, of_logs
    from replay.diagnosis.amended_model import save_amended
    from replay.diagnosis.model_faults import model_faults

    diagnose = _diagnosis(a)
    vehicle, chosen, draft = of_logs(a.vehicle, a.model, a.logs, given(a), a.target_system)
    model = chosen.judged
    if draft is not None and a.save_vehicle is not None:
        write_vehicle("--save-vehicle", a.save_vehicle, draft.as_toml())
    answer = diagnose(a.logs, vehicle, model, target_system=a.target_system, seed=a.seed, progress=progress_bar(a))
    if a.save_model is not None:
        save_amended(a.save_model, model, vehicle, answer.adopted, [r.path for r in answer.records])
    faults = model_faults(answer.records, chosen)
    notes = [] if chosen.note is None else [chosen.note]
    notes += warnings(vehicle) if draft is None else draft.notes
    answer = replace(answer, notes=(*notes, *answer.notes))
    test = _test(a, answer, vehicle, model)
    _write(a, answer, vehicle, faults, test, draft)
    if a.json != "-" and not a.quiet:
        if draft is not None:
            print("\n".join(["vehicle drafted from the log", *(f"  {fact.as_text()}" for fact in draft.known)]))
        _print(a, answer, faults, test)
    return 0


def _test(a: argparse.Namespace, answer: Diagnosis, vehicle: Vehicle, model: FanSurrogate | None) -> Prediction | None:
    """The amended model on the flights of ``--test``."""
    if not a.test:
        return None
    from replay.diagnosis.amended_model import amended
    from replay.predict.predict import predict

    made = amended(model, vehicle, answer.adopted, [r.path for r in answer.records])
    return predict(a.test, vehicle, made, target_system=a.target_system, progress=progress_bar(a))


def _diagnosis(a: argparse.Namespace) -> Callable[..., Diagnosis]:
    """``diagnose``. Where a package that it needs is not installed, a log that cannot be read is said first."""
    try:
        from replay.diagnosis.diagnose import diagnose
    except ModuleNotFoundError:
        from replay.logs.formats import read_pieces

        for log in a.logs:
            next(read_pieces(log, a.target_system), None)
        raise
    return diagnose


def _check_arguments(a: argparse.Namespace) -> None:
    if a.seed < 0:
        raise ConfigError(f"--seed {a.seed}: must not be negative")
    for option, number, most in (
        ("--mass", a.mass, 1e4),
        ("--propeller", a.propeller, 200.0),
        ("--span", a.span, 20.0),
    ):
        if number is not None and not 0.0 < number <= most:
            raise ConfigError(f"{option} {number:g}: must be above 0 and at most {most:g}")
    drafting = {"--mass": a.mass, "--propeller": a.propeller, "--span": a.span, "--save-vehicle": a.save_vehicle}
    for option, value in drafting.items():
        if value is not None and a.vehicle is not None:
            raise ConfigError(f"{option}: is of a drafted vehicle, and --vehicle gives one; leave one of them out")
    files = (("--json", a.json), ("--save-vehicle", a.save_vehicle))
    for option, target in (*files, ("--save-model", a.save_model), ("--report", a.report)):
        if target is not None and str(target) != "-":
            check_target(option, Path(target), folder=option not in dict(files))


def progress_bar(a: argparse.Namespace) -> Callable[[Sequence[Path]], Iterable[Path]]:
    """Wraps the logs that are read: a bar on a terminal, unless ``--quiet``."""
    shown = sys.stderr.isatty() and not a.quiet

    def progress(logs: Sequence[Path]) -> Iterable[Path]:
        from tqdm import tqdm

        bar: Iterable[Path] = tqdm(logs, desc="reading", unit="log", disable=not shown, file=sys.stderr)
        return bar

    return progress


def _write(
    a: argparse.Namespace, answer: Diagnosis, vehicle: Vehicle, faults: list[dict[str, str]],
    test: Prediction | None, draft: Draft | None,
) -> None:  # fmt: skip
    """The files that were asked for; ``faults`` of model and vehicle come first in the JSON."""
    if a.json is not None:
        from replay.cli import write_json

        out = answer.as_json(None if a.save_model is None else str(a.save_model))
        out["log_faults"] = [*faults, *out["log_faults"]]
        if draft is not None:
            out["vehicle"] = draft.as_json()
        if test is not None:
            out["test"] = test.as_json(out["model"])
        write_json(out, a.json)
    if a.report is not None:
        from replay.diagnosis.html_report import write_report

        write_report(a.report, answer, vehicle, faults)


def _print(a: argparse.Namespace, answer: Diagnosis, faults: list[dict[str, str]], test: Prediction | None) -> None:
    from models.effects import InFlight

    for fault in faults:
        print(f"{fault['channel']}: {fault['what']}")
    print(answer.as_text())
    if test is not None:
        print(f"on other flights, {test.as_text()}")
    if a.save_model is not None:
        effects = [n.found.effect for n in answer.named]
        gone = [e.name for e in effects if not e.kept]
        idle = [e.name for e in effects if e.kept and e.in_flight is InFlight.NONE]
        said = [f"not kept: {', '.join(gone)}"] if gone else []
        said += [f"not compensated in flight: {', '.join(idle)}"] if idle else []
        print(f"amended model: {a.save_model}" + (f" ({'; '.join(said)})" if said else ""))
    if a.report is not None:
        print(f"report: {a.report / 'report.html'}")


def _folder(a: argparse.Namespace) -> int:
    if len(a.logs) > 1:
        raise ConfigError("a folder is diagnosed log by log: give it alone, or name the logs that belong together")
    if a.test:
        raise ConfigError(f"--test: needs logs that belong together; name them instead of the folder {a.logs[0]}")
    if a.save_vehicle is not None:
        raise ConfigError("--save-vehicle: a folder's logs may be of several vehicles; name the logs of one")
    if a.save_model is not None:
        raise ConfigError(
            "--save-model: a folder's logs may be of several vehicles; give those of one vehicle by name, as in "
            f"replay diagnose {a.logs[0]}/*.tlog --save-model {a.save_model}"
        )
    from replay.command import given
    from replay.fleet.folder import run_folder
    from replay.fleet.jobs import Kind

    return run_folder(a, a.logs[0], Kind.DIAGNOSE, seed=a.seed, given=given(a))


def check_target(option: str, target: Path, *, folder: bool) -> None:
    """Refuse a place that cannot be written before minutes are spent on what would go there."""
    if not folder and target.is_dir():
        raise ConfigError(f"{option} {target}: is a folder; name a file")
    if folder and target.exists() and not target.is_dir():
        raise ConfigError(f"{option} {target}: is a file; name a folder")
    parent = target if target.is_dir() else target.parent
    while folder and not parent.exists():
        parent = parent.parent
    if not parent.is_dir():
        raise ConfigError(f"{option} {target}: there is no folder {parent}; create it or name another place")
    if not os.access(parent, os.W_OK):
        raise ConfigError(f"{option} {target}: folder {parent} cannot be written; name another place")
