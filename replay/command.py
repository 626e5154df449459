"""What several commands do alike: check where an answer goes, read what is declared, and write the answer."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from companion.vehicles import chosen_vehicle
from models.choice import NONE, Choice, choose
from models.common.arguments import speaks
from models.common.errors import ConfigError, LogError
from models.common.pages.document import write_document
from models.common.text_file import write_json
from models.surrogate.store import load
from models.vehicle import Vehicle
from replay.source_options import source_settings
from replay.vehicle.given import INCH_M, Given

if TYPE_CHECKING:
    from replay.vehicle.draft import Draft

_OUTLINED = (
    "the vehicle is drafted from parameters and outputs alone: its sizes and its thrust are "
    "typical ones"
)
_NO_MODEL = (
    "no model of this vehicle is known: what ground and walls do to it is found in the log, not "
    "known before"
)
"""Of a drafted vehicle that sees a surface."""
_OF_FOLDER = (
    "out",
    "workers",
    "scheduler",
    "log_minutes",
    "log_gb",
    "retry",
    "refresh",
    "vehicles",
    "watch",
)
"""Options."""


def check_declared(vehicle_file: Path | str | None, model: str | None) -> None:
    """A wrong vehicle or model file is said once, before the work."""
    if vehicle_file is not None:
        declared(vehicle_file, model)
    elif model not in (None, NONE):
        load(model)


def declared(vehicle_file: Path | str, model: str | None) -> tuple[Vehicle, Choice]:
    """The vehicle of ``--vehicle``, and the model of ``--model`` for it."""
    vehicle = chosen_vehicle(vehicle_file)
    return vehicle, choose(vehicle, model)


def given(a: argparse.Namespace) -> Given:
    """What ``--mass``, ``--propeller``, ``--span`` and ``--set`` say of a vehicle that is drafted."""
    if a.propeller is None:
        diameter_m = None
    else:
        diameter_m = a.propeller * INCH_M
    return Given(a.mass, diameter_m, a.span, source_settings(a.set))


def of_logs(
    vehicle_file: Path | str | None,
    model: str | None,
    logs: Sequence[Path],
    known: Given,
    target_system: int | None,
    *,
    measured: bool = True,
) -> tuple[Vehicle, Choice, Draft | None]:
    """``declared``; without ``--vehicle`` the vehicle is drafted from the logs, or but outlined (not ``measured``)."""
    if vehicle_file is not None:
        return *declared(vehicle_file, model), None
    # Imported here: a declared vehicle needs nothing of the search that a draft begins with.
    from replay.vehicle.draft import draft

    if model not in (None, NONE):  # a wrong model is said before the logs are read
        load(model)
    made = draft(logs, known, target_system, measured=measured)
    return made.vehicle, _chosen(made.vehicle, model), made


def _chosen(vehicle: Vehicle, model: str | None) -> Choice:
    """The model for a drafted vehicle. Nobody chose the shipped one, so what fan that is of says nothing here."""
    chosen = choose(vehicle, model)
    if chosen.note is None:
        return chosen
    return replace(chosen, note=_NO_MODEL if vehicle.rangefinders else None)


def flown(a: argparse.Namespace) -> tuple[Vehicle, Choice, Sequence[str]]:
    """The vehicle and the model of a log that is replayed, and what is assumed of them.

    Without ``--vehicle`` it is drafted, as far as the log goes.
    """
    vehicle_and_model = partial(of_logs, a.vehicle, a.model, [a.log], Given(), a.target_system)
    try:
        vehicle, chosen, made = vehicle_and_model()
    except LogError:
        # Too short or too slow to be judged is still enough to be replayed, with the outline of the vehicle.
        vehicle, chosen, _ = vehicle_and_model(measured=False)
        return vehicle, chosen, (_OUTLINED,)
    return vehicle, chosen, () if made is None else made.notes


def refuse(a: argparse.Namespace, options: Sequence[str], why: str) -> None:
    """ConfigError where one of these options is given, with the reason."""
    for option in options:
        value = getattr(a, option)
        # 0 is given, and equals False.
        if value is not False and value not in (None, []):
            raise ConfigError(f"--{option.replace('_', '-')}: {why}")


def refuse_of_folder(a: argparse.Namespace) -> None:
    """ConfigError where an option of a folder is given, and no folder."""
    given = [option for option in _OF_FOLDER if hasattr(a, option)]
    refuse(a, given, "is of a folder of logs")


def check_targets(a: argparse.Namespace) -> None:
    """Refuse places that cannot be written before minutes are spent on what would go there."""
    for option in ("json", "save_vehicle", "save_model", "report", "out"):
        given = getattr(a, option, None)
        if given in (None, "-"):
            continue
        is_file = option in ("json", "save_vehicle")
        target = Path(given)
        said = f"--{option.replace('_', '-')} {given}"
        if is_file and target.is_dir():
            raise ConfigError(f"{said}: is a folder; name a file")
        if not is_file and target.exists() and not target.is_dir():
            raise ConfigError(f"{said}: is a file; name a folder")
        if is_file:
            above = [target.parent]
        else:
            above = [target, *target.absolute().parents]
        parent = next((p for p in above if p.exists()), above[0])
        if not parent.is_dir():
            raise ConfigError(
                f"{said}: there is no folder {parent}; create it or name another place"
            )
        if not os.access(parent, os.W_OK):
            raise ConfigError(f"{said}: folder {parent} cannot be written; name another place")


def progress_bar(a: argparse.Namespace) -> Callable[[Sequence[Path]], Iterable[Path]]:
    """Wraps the logs that are read: a bar on a terminal, unless ``--quiet``."""
    # disable=None: only to a terminal.
    return partial(tqdm, desc="reading", unit="log", disable=True if a.quiet else None)


def fault_lines(faults: Sequence[Mapping[str, str]]) -> list[str]:
    """Faults of a model or vehicle file as text."""
    return [f"{fault['channel']}: {fault['what']}" for fault in faults]


def write_answer(
    a: argparse.Namespace,
    content: Mapping[str, Any],
    lines: Sequence[str],
    page: Callable[[], str] | None = None,
) -> None:
    """Write what ``--json`` and, with a ``page``, ``--report`` ask for, and print the lines unless ``--quiet``."""
    if a.json is not None:
        write_json(content, a.json)
    if page is None or a.report is None:
        written = []
    else:
        written = [write_document("--report", a.report / "report.html", page())]
    if speaks(a):
        print("\n".join([*lines, *(f"report: {path}" for path in written)]))
