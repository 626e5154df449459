"""Runs of samples for which something holds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def runs_of(mask: NDArray[np.bool_]) -> list[slice]:
    """Where (n,) is true without a gap, in order."""
    changes = np.flatnonzero(np.diff(mask, prepend=False, append=False))
    return [slice(first, end) for first, end in changes.reshape(-1, 2).tolist()]
