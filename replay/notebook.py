"""A diagnosis in a notebook: logs in, an answer out that shows itself, with its effects as a table."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from html import escape
from pathlib import Path

from companion.vehicles import chosen_vehicle
from models.choice import choose
from models.pages.document import table
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle
from replay.diagnosis import diagnose as asked
from replay.diagnosis.amended_model import amended
from replay.diagnosis.answer import Diagnosis, Named
from replay.diagnosis.html_report import page
from replay.diagnosis.model_faults import model_faults
from replay.predict import page as predict_page
from replay.predict.predict import Prediction, predict
from replay.search.results import Estimate
from replay.vehicle.draft import INCH_M, Draft, Given, draft

DEFAULT = "default"
Logs = Path | str | Sequence[Path | str]


@dataclass(frozen=True)
class Size:
    """One parameter of one effect that was found. ``low``, ``high``: 95 % interval."""

    effect: str
    parameter: str
    value: float
    low: float
    high: float
    unit: str
    probability: float
    explains: float
    status: str
    belongs_to: str

    @classmethod
    def of(cls, named: Named, e: Estimate) -> Size:
        """A parameter of an effect of a diagnosis."""
        low, high = map(float, e.ci95)
        found = named.found
        sure = (found.probability, named.explains, named.status, found.effect.belongs_to.value)
        return cls(found.effect.name, e.name, e.value, low, high, e.unit, *sure)


class Table(list[Size]):
    """Sizes of effects, a row each; ``pandas.DataFrame(table)`` takes it as it is."""

    def _repr_html_(self) -> str:
        rows = [[escape(f"{v:.3g}" if isinstance(v, float) else v) for v in asdict(size).values()] for size in self]
        return table([f.name for f in fields(Size)], rows) or "<p>no effect is missing</p>"


@dataclass(frozen=True)
class Answer(Diagnosis):
    """A diagnosis, as ``replay diagnose`` gives it."""

    draft: Draft | None = None
    """The vehicle, where it was drafted from the logs."""
    model: FanSurrogate | None = None
    """By which the logs were judged; None for rotors in free air."""

    @property
    def vehicle(self) -> Vehicle:
        """By which the logs were judged."""
        return self.records[0].context.vehicle

    @property
    def effects(self) -> Table:
        """What the model lacks, the effects that explain most first."""
        return Table(Size.of(n, e) for n in self.named for e in n.found.estimates)

    @property
    def amended(self) -> FanSurrogate:
        """The model with what was found; ``models.surrogate.store.save_model`` writes it."""
        logs = [r.path for r in self.records]
        return amended(self.model, self.vehicle, self.adopted, logs)

    def predict(self, *logs: Path | str, frozen: bool = False) -> ShownPrediction:
        """The error of the amended model on other flights, as ``replay predict`` gives it."""
        found = predict(_paths(logs), self.vehicle, self.amended, frozen=frozen)
        return ShownPrediction(found.flights, found.frozen, found.notes)

    def _repr_html_(self) -> str:
        return _framed(page(self, self.vehicle, model_faults(self.records, None)))


class ShownPrediction(Prediction):
    """A prediction that shows itself."""

    def _repr_html_(self) -> str:
        return _framed(predict_page.page(self, self.records[0].context.vehicle))


def diagnose(
    logs: Logs,
    vehicle: Vehicle | Path | str | None = None,
    model: FanSurrogate | str | None = DEFAULT,
    *,
    mass_kg: float | None = None,
    propeller_inch: float | None = None,
    span_m: float | None = None,
    target_system: int | None = None,
    progress: Callable[[Sequence[Path]], Iterable[Path]] = lambda paths: paths,
) -> Answer:
    """What the declared model lacks on one log, or on several of one vehicle.

    ``vehicle``: None drafts it from the logs, by ``mass_kg``, ``propeller_inch`` and ``span_m`` where they are known.
    ``model``: a model, its directory, or None for rotors in free air; by default as ``replay diagnose`` chooses it.
    ``progress`` may wrap the logs while they are read.
    """
    paths, drafted = _paths(logs), None
    if vehicle is None:
        diameter_m = None if propeller_inch is None else propeller_inch * INCH_M
        drafted = draft(paths, Given(mass_kg, diameter_m, span_m), target_system)
        vehicle = drafted.vehicle
    elif not isinstance(vehicle, Vehicle):
        vehicle = chosen_vehicle(vehicle)
    if isinstance(model, str):
        model = choose(vehicle, None if model == DEFAULT else model).judged
    found = asked.diagnose(paths, vehicle, model, target_system=target_system, progress=progress)
    known = {f.name: getattr(found, f.name) for f in fields(found)}
    notes = (*(drafted.notes if drafted else ()), *found.notes)
    return Answer(**(known | {"notes": notes}), draft=drafted, model=model)


def _paths(logs: Logs) -> list[Path]:
    return [Path(logs)] if isinstance(logs, Path | str) else [Path(log) for log in logs]


def _framed(document: str) -> str:
    """A whole page inside another: its style stays its own."""
    style = "width:100%;height:40rem;border:0"
    return f'<iframe title="answer" style="{style}" sandbox srcdoc="{escape(document)}"></iframe>'
