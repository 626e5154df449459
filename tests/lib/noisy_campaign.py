"""Data as a CFD campaign gives them: few places, noise, gaps, other speeds filled by a law, symmetric components."""

from __future__ import annotations

import numpy as np

from models.corner_law import ClosedForm
from models.dataset import DataSet

FAN = ClosedForm()
R = FAN.radius_m
HEIGHTS = np.array([1, 1.25, 1.5, 1.75, 2, 2.5, 3, 4, 5, np.inf]) * R
WALLS = np.array([0.15, 0.3, 0.5, 0.75, 1, 1.5, 2, 2.75, 3.8, 5, np.inf]) * R
RPM = 4000.0
SPEEDS = (2800.0, 3400.0, RPM, 4600.0, 5200.0)


def noisy_campaign(
    noise: float = 0.005, *, seed: int = 0, mirrored: bool = True, pitch_bias: float = 0.007
) -> DataSet:
    """About a hundred places; ``noise`` is the sd of Fz over the hover lift, a third of it in the other components.

    ``mirrored``: half models, Fy = Mx = Mz = 0; else those three are noise about 0, 0 and a constant. ``pitch_bias``
    [N m] is added to My everywhere, as an asymmetric mesh does.
    """
    rng = np.random.default_rng(seed)
    h, d = (a.ravel() for a in np.meshgrid(HEIGHTS, WALLS, indexing="ij"))
    kept = (rng.random(len(h)) > 0.1) | (np.isinf(h) & np.isinf(d))
    h, d = h[kept], d[kept]
    at_hover = FAN.wrench(h, d, RPM)
    at_hover[:, [1, 3, 5]] = 0.0
    spread = noise * float(FAN.lift(RPM)) * np.array([1, 1, 3, R, R, R]) / 3
    drawn = spread * rng.normal(size=at_hover.shape)
    if mirrored:
        drawn[:, [1, 3, 5]] = 0.0
    else:
        at_hover[:, 5] = 0.1
    at_hover += drawn
    at_hover[:, 4] += pitch_bias
    rows = [
        np.column_stack([h, d, np.full(len(h), n), at_hover * (n / RPM) ** 2.04]) for n in SPEEDS
    ]
    table = np.concatenate(rows)
    return DataSet(
        h=table[:, 0],
        d=table[:, 1],
        rpm=table[:, 2],
        wrench=table[:, 3:],
        source="campaign",
        sha256="",
    )
