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

    Parameters
    ----------
    data : DataSet, path or str
        Measured or simulated wrenches, or their CSV file (docs/formats.md): SI, corner frame.
    method : str
        ``bp``, ``ga-bp``, ``adam-bp`` and ``ga-adam-bp`` are the paper's (Ai, Xu, Xiang, Fan & Zhang 2020, Sensors 20,
        5805; they need the extra ``train``); ``kriging``, ``polynomial`` and ``ensemble`` are others.
    seed : int
        Of the split of the data and the first weights.
    fan_radii_m : (float, float) or None
        Radius of rotor and outer lip [m]. They are kept, so that the model is not flown on another fan.

    Returns
    -------
    FanSurrogate
        ``info["metrics"]`` has its errors at places that were not trained on.

    Raises
    ------
    ModelError
        The data cannot be read or are too few, or the method is not known.

    Examples
    --------
    >>> import models
    >>> models.train("fan.csv", method="polynomial")
    FanSurrogate(method='polynomial', rows=2310, effects=[])
    """
    rows = data if isinstance(data, DataSet) else read(Path(data))
    return training.train(rows, method, seed, fan_radii_m=fan_radii_m).model
