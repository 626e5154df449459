"""Swings: which one frequency has most of the energy of a force or moment."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from models.common.frames import Array
from replay.residual.record import Record

FEWEST_SWINGS = 4
"""In a flight, for it to be one of a frequency."""
LINES = (-1, 0, 1)
"""Lines of a periodogram with Hann's window that a swing is in, beside its own."""


class Swing(NamedTuple):
    """The strongest of a flight; zeros where the flight is too short or nothing moves."""

    hz: float = 0.0
    share: float = 0.0
    """Of the energy about the mean."""
    line_hz: float = 0.0
    """How far two lines of the periodogram are apart [Hz]."""


def strongest_swing(record: Record, x: Array) -> Swing:
    """The swing with most of the energy of x (n,) in a flight: by a periodogram with Hann's window.

    Noise and unsteady air spread over many frequencies, a swing is in the three lines about its own (Harris 1978,
    Proc. IEEE 66, 51).
    """
    if not record.valid.any():
        return Swing()
    mean = x[record.valid].mean()
    about_mean = np.where(record.valid, x - mean, 0.0)
    power = np.abs(np.fft.rfft(about_mean * np.hanning(len(x)))) ** 2
    whole = float(power.sum())
    if len(power) <= 2 * FEWEST_SWINGS or whole <= 0.0:
        return Swing()
    highest = FEWEST_SWINGS + int(np.argmax(power[FEWEST_SWINGS:]))
    lines = highest + np.array(LINES)
    energy = float(power[lines[lines < len(power)]].sum())
    line_hz = 1.0 / (len(x) * record.step_s)
    return Swing(hz=highest * line_hz, share=energy / whole, line_hz=line_hz)
