"""The ``models`` command: train, compare and query surrogates, compute their data."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from models.cfd import cli as cfd
from models.common.arguments import Parser, VersionAction, run_command, speaks
from models.common.errors import ConfigError
from models.common.text_file import make_folder, write_json

# Spelled out here so that --help need not import the trainers.
METHODS = ("bp", "ga-bp", "adam-bp", "ga-adam-bp", "kriging", "polynomial", "ensemble")
CLOSED_FORM = "closed-form"
PAPER_RADII_M = (0.165, 0.21)
"""Rotor and outer lip radius of the fan that the closed form is of."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code: 0 done, 2 bad input, 130 interrupted."""
    args = _parser().parse_args(argv)
    return run_command("models", "train", lambda: _run(args))


def _run(args: argparse.Namespace) -> int:
    content = args.run(args)
    if args.json is not None:
        write_json(content, args.json)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="models",
        description="Surrogates of a fan near ground and wall: train, compare, query, compute "
        "data.",
    )
    parser.add_argument(
        "--version", action=VersionAction, nargs=0, help="print the version and exit"
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    every = Parser(add_help=False)
    every.add_argument(
        "--json", metavar="FILE", help="write the numbers as JSON here, '-' for stdout"
    )
    every.add_argument("--quiet", action="store_true", help="no progress bar, no text")
    data = Parser(add_help=False, parents=[every])
    data.add_argument(
        "--data",
        required=True,
        metavar="CSV",
        help=f"data set, or '{CLOSED_FORM}' for the built-in one (not CFD)",
    )
    data.add_argument(
        "--sigma",
        type=Path,
        metavar="CSV",
        help="how sure each row is, as 'models cfd assemble' writes it: the rows of the ensemble "
        "are weighted by it",
    )
    data.add_argument(
        "--seed", type=int, default=0, metavar="N", help="of splits and starts (default 0)"
    )

    _add_train(commands, data)
    compare = commands.add_parser(
        "compare", parents=[data], help="train all methods and compare them"
    )
    compare.add_argument("--report", type=Path, metavar="DIR", help="write the report here")
    compare.set_defaults(run=_compare)

    _add_query(commands, every)
    _add_paper(commands, every)
    cfd.add(commands, every)
    return parser


def _add_train(commands: Any, data: argparse.ArgumentParser) -> None:
    train = commands.add_parser(
        "train", parents=[data], help="train a surrogate on a data set and write a model directory"
    )
    train.add_argument(
        "--method",
        required=True,
        choices=METHODS,
        help="'ensemble' is what flies: see docs/surrogates.md",
    )
    train.add_argument(
        "--out", required=True, type=Path, metavar="DIR", help="model directory to write"
    )
    train.add_argument(
        "--fan",
        nargs=2,
        type=float,
        metavar=("RADIUS", "LIP"),
        help="rotor and outer lip radius [m] of the fan that the data are of: flight then refuses "
        "it on another fan",
    )
    train.add_argument(
        "--places",
        choices=("even", "odd"),
        help="train on every second place only: a test may then use the others (sim:corner_cfd "
        "flies in the even ones)",
    )
    train.add_argument(
        "--label", metavar="TEXT", help="what the data are, kept in model.json as their fidelity"
    )
    train.set_defaults(run=_train)


def _add_query(commands: Any, every: argparse.ArgumentParser) -> None:
    query = commands.add_parser(
        "query", parents=[every], help="ask a model for the wrench at one point"
    )
    query.add_argument(
        "directory",
        nargs="?",
        type=Path,
        metavar="DIR",
        help="model directory (default: the shipped one)",
    )
    query.add_argument("--model", type=Path, metavar="DIR", help="the same as DIR")
    query.add_argument(
        "--vehicle", type=Path, metavar="FILE.toml", help="with --model none: whose rotors"
    )
    query.add_argument(
        "--h", required=True, type=float, metavar="H", help="height [m], 'inf' without ground"
    )
    query.add_argument(
        "--d", required=True, type=float, metavar="D", help="lip to wall [m], 'inf' without wall"
    )
    query.add_argument("--rpm", required=True, type=float, metavar="N", help="rotor speed [1/min]")
    query.set_defaults(run=_query)


def _add_paper(commands: Any, every: argparse.ArgumentParser) -> None:
    paper = commands.add_parser(
        "paper",
        parents=[every],
        help="all figures and tables of the paper's replication, from the shipped data",
    )
    paper.add_argument(
        "--out", required=True, type=Path, metavar="DIR", help="for report.html and the tables"
    )
    paper.add_argument(
        "--splits", type=int, default=20, metavar="N", help="8:2 splits by place (default 20)"
    )
    paper.add_argument(
        "--epochs", type=int, default=1000, metavar="N", help="of each net (default 1000)"
    )
    paper.add_argument(
        "--seed", type=int, default=0, metavar="N", help="of splits and starts (default 0)"
    )
    paper.set_defaults(run=_paper)


def _train(args: argparse.Namespace) -> Mapping[str, Any]:
    from models.common.progress import Bars
    from models.dataset import half
    from models.surrogate import store
    from models.training.train import train

    data, fidelity = _data(args.data, args.sigma)
    if args.places is not None:
        data = half(data, args.places)
    make_folder("directory", args.out)
    if args.label:
        fidelity = {**fidelity, "label": args.label}
    bars = Bars(args.quiet)
    trained = train(
        data, args.method, args.seed, fidelity=fidelity, fan_radii_m=_fan_radii(args), progress=bars
    )
    bars.close()
    store.save_model(args.out, trained.model)
    report = {**trained.report, "out": str(args.out)}
    if not speaks(args):
        return report
    for note in report["notes"]:
        print(f"note: {note}")
    print(
        f"{args.method} on {report['rows']} rows of {data.source}, {report['seconds']:.1f} s, "
        f"written to {args.out}"
    )
    print(
        f"{'':4}{'R2 train':>10}{'R2 test':>10}{'MSE test':>12}{'R2 of increments':>18}{'within 1.96 sigma':>20}"
    )
    for axis, row in report["test"].items():
        print(
            f"{axis:4}{_r2(report['train'][axis]):>10}{_r2(row):>10}{row['mse']:12.3e}"
            f"{_r2(report['increments']['test'][axis]):>18}{report['coverage_95']['test'][axis]:20.1%}"
        )
    return report


def _r2(score: Mapping[str, Any]) -> str:
    if score["r2"] is None:
        return "constant"
    return f"{score['r2']:.4f}"


def _compare(args: argparse.Namespace) -> Mapping[str, Any]:
    from models.common.progress import Bars
    from models.training.compare import compare, text, write_page

    data, _ = _data(args.data, args.sigma)
    if args.report:
        make_folder("directory", args.report)
    bars = Bars(args.quiet)
    result = compare(data, args.seed, progress=bars)
    bars.close()
    if args.sigma is None:
        sigma = ""
    else:
        sigma = f" --sigma {args.sigma}"
    command = (
        f"models train --data {args.data}{sigma} --method {result.numbers['use']['method']} --out "
        "DIR"
    )
    if args.report:
        write_page(args.report, result, command)
    if speaks(args):
        print(text(result.numbers))
        print(f"next: {command}")
        if args.report:
            print(f"report: {args.report / 'report.html'}")
    return result.numbers


def _paper(args: argparse.Namespace) -> Mapping[str, Any]:
    from models.cfd.config import load as load_setup
    from models.cfd.statements import check
    from models.cfd.table import read
    from models.common.progress import Bars
    from models.paper import report
    from models.paper.flow import flow_exhibits
    from models.paper.nets import net_exhibits
    from models.training.compare import compare

    for name in ("splits", "epochs"):
        if getattr(args, name) < 1:
            raise ConfigError(f"--{name} {getattr(args, name)}: must be at least 1")
    make_folder("directory", args.out)
    cases = cfd.SHIPPED_CASES
    data, _ = _data(str(cases.with_name("corner_cfd.csv")), cases.with_name("corner_cfd_rows.csv"))
    bars = Bars(args.quiet)
    result = compare(data, args.seed, splits=args.splits, epochs=args.epochs, progress=bars)
    bars.close()
    checked = check(read(cases), load_setup(None))
    exhibits = [*flow_exhibits(checked), *net_exhibits(data, result)]
    page = report.write(args.out, exhibits)
    if speaks(args):
        print(report.text(exhibits))
        print(f"report: {page}")
    return {"exhibits": [one.as_json() for one in exhibits], "numbers": result.numbers}


def _query(args: argparse.Namespace) -> Mapping[str, Any]:
    if args.directory is not None and args.model is not None and args.directory != args.model:
        raise ConfigError(
            f"models query: DIR {args.directory} and --model {args.model} differ; give one"
        )
    for name in ("h", "d", "rpm"):
        value = getattr(args, name)
        if math.isnan(value) or value < 0.0 or (name == "rpm" and math.isinf(value)):
            raise ConfigError(f"--{name} {value:g}: must be a number of at least 0")
    from models.common.frames import AXES
    from models.surrogate.store import load

    directory = args.directory or args.model
    if str(directory) == "none":
        from models.surrogate.empty import empty_model
        from models.vehicle import load_vehicle

        if args.vehicle is None:
            raise ConfigError(
                "--model none: needs --vehicle FILE.toml, whose rotors in free air it is"
            )
        model = empty_model(load_vehicle(args.vehicle))
    else:
        model = load(directory)
    wrench, sigma, trust = model.query(args.h, args.d, args.rpm)
    free = model.free_air(args.rpm)
    result = {
        "model": str(directory) if directory else "default",
        "h_m": args.h if math.isfinite(args.h) else "inf",
        "d_m": args.d if math.isfinite(args.d) else "inf",
        "rpm": args.rpm,
        "wrench": dict(zip(AXES, wrench.tolist(), strict=True)),
        "sigma": dict(zip(AXES, sigma.tolist(), strict=True)),
        "free_air": dict(zip(AXES, free.tolist(), strict=True)),
        "trust": float(trust),
        "fidelity": model.info.get("fidelity"),
    }
    if speaks(args):
        print(f"h {args.h:g} m, d {args.d:g} m, {args.rpm:g} rpm: trust {trust:.2f}, corner frame")
        print(f"{'':4}{'wrench':>12}{'sigma':>12}{'free air':>12}")
        for c, axis in enumerate(AXES):
            if c < 3:
                unit = "N"
            else:
                unit = "N m"
            print(f"{axis:4}{wrench[c]:12.5f}{sigma[c]:12.5f}{free[c]:12.5f} {unit}")
    return result


def _data(name: str, sigma: Path | None = None) -> tuple[Any, dict[str, Any]]:
    """The data set, with sigma where that is given, and what is known of its fidelity."""
    if name == CLOSED_FORM:
        from models.corner_law import FIDELITY, ClosedForm

        if sigma is not None:
            raise ConfigError(
                f"--sigma {sigma}: the closed form has none; give it with the CSV that it belongs "
                "to"
            )
        return ClosedForm().data_set(), dict(FIDELITY)
    from models.dataset import read, with_sigma

    data = read(name)
    fidelity = {"level": None, "label": "not stated: --label says it"}
    return data if sigma is None else with_sigma(data, sigma), fidelity


def _fan_radii(args: argparse.Namespace) -> tuple[float, float] | None:
    if args.fan is None:
        if args.data == CLOSED_FORM:
            return PAPER_RADII_M
        return None
    radius, lip = args.fan
    if not 0.0 < radius <= lip < 100.0:
        raise ConfigError(
            f"--fan {radius:g} {lip:g}: must be the rotor's radius and the lip's, which is no "
            "smaller"
        )
    return radius, lip
