"""Records of noise with effects added to the residual, for the tests of the search: plumbing, not physics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from noise_records import noise_record

from models.effects import Effect, catalogue, get
from replay.residual.record import Record

BIAS_M_S2 = 0.5
"""Of the accelerometer's x axis."""


def some(*names: str) -> list[Effect]:
    """These effects of the catalogue."""
    return [e for e in catalogue() if e.name in names]


def biased(seed: int = 11, seconds: float = 60.0, bias: float = BIAS_M_S2) -> Record:
    """Noise, and what an accelerometer's offset leaves in the residual."""
    record = noise_record(seed, seconds, 0.3)
    x = np.nan_to_num(get("imu_bias").regressors(record.context, ()))
    return replace(record, residual=record.residual + bias * x[..., 0])
