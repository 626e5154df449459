"""Recorded flights through the same pipeline, and the loop closed with measured data.

``load(LOG)`` reads a log as flights in SI units. ``diagnose(LOGS)`` says what the model of the vehicle lacks;
``Diagnosis`` is the same as an estimator with ``fit``, ``predict`` and ``score``. ``rollout`` moves a model ahead.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from models.common.lazy_exports import exports

if TYPE_CHECKING:
    from replay.estimator import Diagnosis
    from replay.flightlog import FlightLog
    from replay.logs.formats import load
    from replay.notebook import diagnose
    from replay.predict.rollout import FlightModel, rollout
    from replay.residual.record import Record, build_record

    __version__: str

__all__ = [
    "Diagnosis",
    "FlightLog",
    "FlightModel",
    "Record",
    "build_record",
    "diagnose",
    "load",
    "rollout",
]

_HOMES = {
    "Diagnosis": "replay.estimator",
    "FlightLog": "replay.flightlog",
    "FlightModel": "replay.predict.rollout",
    "Record": "replay.residual.record",
    "build_record": "replay.residual.record",
    "diagnose": "replay.notebook",
    "load": "replay.logs.formats",
    "rollout": "replay.predict.rollout",
}
__getattr__, __dir__ = exports(__name__, _HOMES)
