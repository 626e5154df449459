"""``models.train``: a surrogate from data, in one call."""

from __future__ import annotations

from pathlib import Path

from models.dataset import DataSet, read
from models.surrogate.fan_surrogate import FanSurrogate
from models.training import train as training


def train(
    data: DataSet | Path | str,
    method: str = "ga-adam-bp",
    *,
    seed: int = 0,
    fan_radii_m: tuple[float, float] | None = None,
) -> FanSurrogate:
    """A surrogate of one fan: six wrench components over height, wall distance and rotor speed.

    ``data``: a data set or its CSV file (docs/formats.md). ``method``: ``bp``, ``ga-bp``, ``adam-bp`` and
    ``ga-adam-bp`` are the paper's (Ai, Xu, Xiang, Fan & Zhang 2020, Sensors 20, 5805; they need torch), ``kriging``,
    ``polynomial`` and ``ensemble`` are others. ``fan_radii_m``: rotor and outer lip radius, kept in the model so that
    it is not flown on another fan. What it reaches on places that were not trained on is in ``info["metrics"]``.

    Raises ModelError where the data or the method are wrong.

    >>> import models
    >>> from pathlib import Path
    >>> flow = Path(models.__file__).with_name("data") / "corner_cfd.csv"
    >>> models.train(flow, method="polynomial")
    FanSurrogate(method='polynomial', rows=330, effects=[])
    """
    rows = data if isinstance(data, DataSet) else read(Path(data))
    return training.train(rows, method, seed, fan_radii_m=fan_radii_m).model
