"""``replay.diagnose``: logs in, an answer out that shows itself in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from threadpoolctl import threadpool_limits

from companion.vehicles import chosen_vehicle
from models.choice import choose
from models.common.errors import LogError
from models.common.pages.shown import ShownPage
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle
from replay.diagnosis import diagnose as diagnosis
from replay.diagnosis.answer import Diagnosis
from replay.diagnosis.html_report import page
from replay.diagnosis.model_faults import model_faults
from replay.vehicle.draft import draft
from replay.vehicle.given import INCH_M, MOST_INCH, MOST_KG, MOST_SPAN_M, Given, check_size

DEFAULT = "default"


@dataclass(frozen=True, repr=False)
class NotebookDiagnosis(Diagnosis):
    """A diagnosis, as ``replay diagnose`` gives it, that a notebook shows as its page."""

    def _repr_html_(self) -> str:
        document = page(self, self.records[0].context.vehicle, model_faults(self.records, None))
        return ShownPage(document)._repr_html_()


def diagnose(
    logs: Path | str | Sequence[Path | str],
    vehicle: Vehicle | Path | str | None = None,
    model: FanSurrogate | str | None = DEFAULT,
    *,
    mass_kg: float | None = None,
    propeller_inch: float | None = None,
    span_m: float | None = None,
    target_system: int | None = None,
) -> NotebookDiagnosis:
    """What the declared model lacks on one log, or on several of one vehicle.

    Parameters
    ----------
    logs : path, str, or sequence of them
        One log, or several of one vehicle.
    vehicle : Vehicle, path, str or None
        A vehicle, its file, or the name of one that ships. None: drafted from the logs.
    model : FanSurrogate, str or None
        A surrogate or its directory. None: rotors in free air. "default": as ``replay diagnose`` chooses.
    mass_kg, propeller_inch, span_m : float or None
        What is known of a drafted vehicle: mass [kg], diameter of a propeller [inch], motor to opposite motor [m].
    target_system : int or None
        MAVLink system of the vehicle, where a log holds several.

    Returns
    -------
    NotebookDiagnosis
        ``found`` has the effects, ``records`` the residuals; a notebook shows it as its page.

    Raises
    ------
    LogError
        A log cannot be judged, or none is given.
    ConfigError, ModelError
        Vehicle, model or a number are wrong.

    Examples
    --------
    >>> import replay
    >>> answer = replay.diagnose("flight.tlog", "my.toml", model=None)
    >>> "payload" in [found.effect.name for found in answer.found]
    True
    """
    paths = log_paths(logs)
    given = _given(mass_kg, propeller_inch, span_m)
    notes: Sequence[str] = ()
    read = None
    if vehicle is None:
        drafted = draft(paths, given, target_system)
        vehicle = drafted.vehicle
        notes = drafted.notes
        read = drafted.read
    elif not isinstance(vehicle, Vehicle):
        vehicle = chosen_vehicle(vehicle)
    if isinstance(model, str):
        model = choose(vehicle, None if model == DEFAULT else model).judged
    # Matrices here are small: a second thread of linear algebra would wait, and take a core to do so.
    with threadpool_limits(limits=1):
        found = diagnosis.diagnose(paths, vehicle, model, target_system=target_system, read=read)
    return NotebookDiagnosis(**vars(replace(found, notes=(*notes, *found.notes))))


def _given(mass_kg: float | None, propeller_inch: float | None, span_m: float | None) -> Given:
    """What is known of a vehicle, checked."""
    check_size("mass_kg", mass_kg, MOST_KG)
    check_size("propeller_inch", propeller_inch, MOST_INCH)
    check_size("span_m", span_m, MOST_SPAN_M)
    if propeller_inch is None:
        return Given(mass_kg, None, span_m)
    return Given(mass_kg, propeller_inch * INCH_M, span_m)


def log_paths(logs: Path | str | Sequence[Path | str]) -> list[Path]:
    """One log or several, as paths. Raises LogError where there is none."""
    if isinstance(logs, Path | str):
        return [Path(logs)]
    paths = [Path(log) for log in logs]
    if not paths:
        raise LogError("no log is given")
    return paths
