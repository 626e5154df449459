"""``replay.Diagnosis``: a diagnosis as an estimator with ``fit``, ``predict`` and ``score``, as in scikit-learn."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from sklearn.base import BaseEstimator

from models.common.errors import NotFittedError
from models.common.frames import AXES
from models.common.pages.shown import ShownPage
from models.surrogate.fan_surrogate import FanSurrogate
from models.surrogate.store import save_model
from models.vehicle import Vehicle
from replay.diagnosis.amended_model import amended
from replay.diagnosis.html_report import page
from replay.diagnosis.model_faults import model_faults
from replay.effect_table import EffectTable, effect_table
from replay.notebook import DEFAULT, NotebookDiagnosis, diagnose
from replay.predict.predict import Prediction, predict
from replay.search.channel import hundredths

Log = Path | str


class Diagnosis(BaseEstimator):  # type: ignore[misc]  # scikit-learn has no types
    """What a declared model of a vehicle lacks, learned from logs, and how well that holds on other logs.

    Parameters
    ----------
    vehicle : vehicle, path of a vehicle file, or None
        None: drafted from the logs that are fitted.
    model : surrogate, its directory, "none", None, or "default"
        None and "none": rotors in free air. "default": as ``replay diagnose`` chooses.
    mass_kg, propeller_inch, span_m : float or None
        What is known of a drafted vehicle.

    Attributes
    ----------
    answer_ : the whole answer, as ``replay.diagnose`` gives it
    effects_ : table of the effects that were found, a row a parameter
    model_ : the amended model: what of the effects belongs to the vehicle
    vehicle_ : the vehicle that flew

    Raises LogError where a log cannot be judged, ConfigError and ModelError where vehicle or model are wrong.

    Examples
    --------
    >>> from replay import Diagnosis
    >>> Diagnosis(vehicle="my.toml", model=None)
    Diagnosis(model=None, vehicle='my.toml')
    """

    answer_: NotebookDiagnosis
    effects_: EffectTable
    model_: FanSurrogate
    vehicle_: Vehicle

    def __init__(
        self,
        vehicle: Vehicle | Log | None = None,
        model: FanSurrogate | str | None = DEFAULT,
        *,
        mass_kg: float | None = None,
        propeller_inch: float | None = None,
        span_m: float | None = None,
    ) -> None:
        self.vehicle = vehicle
        self.model = model
        self.mass_kg = mass_kg
        self.propeller_inch = propeller_inch
        self.span_m = span_m

    def fit(self, logs: Log | Sequence[Log], y: object = None) -> Diagnosis:
        """Find the effects that the model lacks on a log, or on several of one vehicle. ``y`` is not used."""
        self.answer_ = diagnose(
            logs,
            self.vehicle,
            self.model,
            mass_kg=self.mass_kg,
            propeller_inch=self.propeller_inch,
            span_m=self.span_m,
        )
        records = self.answer_.records
        paths = list(dict.fromkeys(record.path for record in records))
        declared = records[0].context.model
        base = declared if isinstance(declared, FanSurrogate) else None
        self.vehicle_ = self.answer_.vehicle
        self.effects_ = effect_table(self.answer_)
        self.model_ = amended(base, self.vehicle_, self.answer_.adopted, paths)
        return self

    def predict(
        self, logs: Log | Sequence[Log], *, frozen: bool = False, horizon_s: float | None = None
    ) -> Prediction:
        """The error of the amended model on other logs, with and without the effects that were found.

        Without ``frozen``, wind, load and accelerometer offset are learned from the first 20 s of each flight.
        ``horizon_s``: the motion is foretold, too, so far ahead [s].
        """
        self._check()
        return predict(_paths(logs), self.vehicle_, self.model_, frozen=frozen, horizon_s=horizon_s)

    def score(self, logs: Log | Sequence[Log], y: object = None, *, frozen: bool = False) -> float:
        """Share of the residual's energy on other logs that the amended model explains: 1 is all, < 0 is harm.

        Wind, load and accelerometer offset of the day, learned from the first 20 s of each flight, are a part of it.
        With ``frozen`` the effects of the vehicle stand alone. Energy is the sum over axes of squares, in hundredths
        of the weight (times the arm, for moments). ``y`` is not used.
        """
        prediction = self.predict(logs, frozen=frozen)
        unit = hundredths(prediction.records[0].context)
        without = 0.0
        left = 0.0
        for axis, error in prediction.axes().items():
            size = float(unit[AXES.index(axis)])
            without += (error["rms_without"] / size) ** 2
            left += (error["rms_with"] / size) ** 2
        return float(1.0 - left / np.maximum(without, 1e-300))

    def plot(self) -> ShownPage:
        """The page of the answer, with its plots: a notebook shows it, ``save(FILE)`` writes it."""
        self._check()
        return ShownPage(
            page(self.answer_, self.vehicle_, model_faults(self.answer_.records, None))
        )

    def save(self, folder: Log) -> Path:
        """Write the amended model; ``replay``, ``companion`` and ``models.load`` take the folder."""
        self._check()
        save_model(Path(folder), self.model_)
        return Path(folder)

    def _check(self) -> None:
        if not hasattr(self, "answer_"):
            raise NotFittedError("this Diagnosis is not fitted yet: call fit(LOGS) first")


def _paths(logs: Log | Sequence[Log]) -> list[Path]:
    if isinstance(logs, Path | str):
        return [Path(logs)]
    return [Path(log) for log in logs]
