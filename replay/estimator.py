"""``replay.Diagnosis``: a diagnosis as an estimator with ``fit``, ``predict`` and ``score``, as in scikit-learn."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from sklearn.base import BaseEstimator

from models.common.errors import ConfigError, NotFittedError
from models.common.frames import AXES
from models.common.pages.shown import ShownPage
from models.surrogate.fan_surrogate import FanSurrogate
from models.surrogate.store import save_model
from models.vehicle import Vehicle
from replay.diagnosis.amended_model import amended
from replay.diagnosis.html_report import page
from replay.diagnosis.model_faults import model_faults
from replay.effect_table import EffectTable, effect_table
from replay.notebook import DEFAULT, NotebookDiagnosis, diagnose, log_paths
from replay.predict.predict import Prediction, predict
from replay.search.channel import hundredths

Log = Path | str


class Diagnosis(BaseEstimator):  # type: ignore[misc]  # scikit-learn has no types
    """What a declared model of a vehicle lacks, learned from logs, and how well that holds on other logs.

    Parameters
    ----------
    vehicle : Vehicle, path, str or None
        A vehicle, its file, or the name of one that ships. None: drafted from the logs that are fitted.
    model : FanSurrogate, str or None
        A surrogate or its directory. None and "none": rotors in free air. "default": as ``replay diagnose`` chooses.
    mass_kg, propeller_inch, span_m : float or None
        What is known of a drafted vehicle: mass [kg], diameter of a propeller [inch], motor to opposite motor [m].

    Examples
    --------
    >>> from replay import Diagnosis
    >>> diagnosis = Diagnosis(vehicle="my.toml", model=None)
    >>> diagnosis
    Diagnosis(model=None, vehicle='my.toml')
    >>> "payload" in diagnosis.fit("flight.tlog").effects_.names
    True
    >>> bool(diagnosis.score("friday.tlog") > 0.5)  # of the energy of another flight's residual
    True
    >>> diagnosis.plot().save("answer.html").name
    'answer.html'
    >>> diagnosis.save("amended").name  # for companion --model, replay --model and models.load
    'amended'
    """

    answer_: NotebookDiagnosis
    """The whole answer, as ``replay.diagnose`` gives it."""
    effects_: EffectTable
    """The effects that were found, a row a parameter: value, 95 % interval, unit, probability."""
    model_: FanSurrogate
    """The amended model: what of the effects belongs to the vehicle."""
    vehicle_: Vehicle
    """The vehicle that flew."""

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
        """Find the effects that the model lacks.

        Parameters
        ----------
        logs : path, str, or sequence of them
            One log, or several of one vehicle.
        y : object
            Not used.

        Returns
        -------
        Diagnosis
            Itself.

        Raises
        ------
        LogError
            A log cannot be judged, or none is given.
        ConfigError, ModelError
            Vehicle or model are wrong.
        """
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

        Parameters
        ----------
        logs : path, str, or sequence of them
            One log, or several.
        frozen : bool
            False: wind, load, accelerometer offset, drag that the model lacks and the sizes of its effects are learned
            from the first 20 s of each flight. True: the effects stand as they are.
        horizon_s : float or None
            The motion is foretold, too, so far ahead [s].

        Returns
        -------
        Prediction
            Residuals (n, 6) of each flight [N, N m], body FRD; their RMS by axis and regime.

        Raises
        ------
        NotFittedError
            ``fit`` was not called.
        LogError
            A log cannot be judged, or none is given.
        ConfigError
            The horizon is not above 0.
        """
        self._check()
        if horizon_s is not None and not horizon_s > 0.0:
            raise ConfigError(f"horizon_s {horizon_s:g}: must be above 0")
        return predict(
            log_paths(logs), self.vehicle_, self.model_, frozen=frozen, horizon_s=horizon_s
        )

    def score(self, logs: Log | Sequence[Log], y: object = None, *, frozen: bool = False) -> float:
        """Share of the residual's energy on other logs that the amended model explains.

        Energy is the sum over axes of squares, in hundredths of the weight (times the arm, for moments).

        Parameters
        ----------
        logs : path, str, or sequence of them
            One log, or several.
        y : object
            Not used.
        frozen : bool
            As of ``predict``.

        Returns
        -------
        float
            1 is all, 0 is nothing, below 0 is harm.

        Raises
        ------
        NotFittedError
            ``fit`` was not called.
        LogError
            A log cannot be judged, or none is given.
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
        """The page of the answer, with its plots.

        Returns
        -------
        ShownPage
            A notebook shows it; ``save(FILE)`` writes it as HTML.

        Raises
        ------
        NotFittedError
            ``fit`` was not called.
        """
        self._check()
        return ShownPage(
            page(self.answer_, self.vehicle_, model_faults(self.answer_.records, None))
        )

    def save(self, folder: Log) -> Path:
        """Write the amended model; ``replay``, ``companion`` and ``models.load`` take the folder.

        Parameters
        ----------
        folder : path or str
            Made where there is none.

        Returns
        -------
        Path
            The folder.

        Raises
        ------
        NotFittedError
            ``fit`` was not called.
        ModelError
            The folder cannot be written.
        """
        self._check()
        save_model(Path(folder), self.model_)
        return Path(folder)

    def _check(self) -> None:
        if not hasattr(self, "answer_"):
            raise NotFittedError("this Diagnosis is not fitted yet: call fit(LOGS) first")
