"""Rotor speeds as every format gives them: without marks of "unknown", lost frames and repeated batches."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from models.common.frames import Array, Mask
from replay.flightlog import EscRecord, FlightLog, Series

UNKNOWN_RPM = (65535.0, -1.0)
"""What stands for "unknown" on a link of unsigned 16 bits, and of a sensor that reads nothing."""
FASTEST_RPM = 200_000.0
"""No hobby motor turns faster; a mark of 32 bits, or one that was divided by the poles, is larger."""
REVERSED_SHARE = 0.5
"""MAVLink and uORB give a rotor that turns backwards negative speeds: nearly all of them, not one now and then."""
LOST_S = 0.5
"""A propeller does not stop and come back within this time: spinning down takes longer (Crazyflie: 0.3 s)."""
LOST_SHARE = 0.02
"""Share of the speeds from which on zeros between them are a habit of the telemetry: one alone may be a fault."""
SPIKE = 2.0
"""A propeller at twice the speed of its neighbours in time would give four times the thrust, and lose it again."""
BATCH = 4
"""ESCs of one telemetry message."""
FEWEST_SAMPLES = 20
"""Samples that tell a copy from chance."""
WORTH_A_NOTE = 0.01
"""Share of speeds that are left out from which on it is said."""
SAME_SHARE = 0.95
"""Share of equal samples of a copy: the last message of a batch may be missing."""


def with_believable_speeds(log: FlightLog) -> FlightLog:
    """The log with ``believable_escs``, and their notes among its own."""
    escs, notes = believable_escs(log.escs)
    summary = replace(log.summary, notes=(*log.summary.notes, *notes))
    return replace(log, escs=escs, summary=summary)


def believable_escs(escs: Mapping[int, EscRecord]) -> tuple[dict[int, EscRecord], list[str]]:
    """ESCs (from 1) with believable speeds alone, and a note on what was left out.

    An ESC without any believable speed keeps its temperature. One of a batch that repeats the batch before is dropped.
    """
    known: dict[int, EscRecord] = {}
    notes = []
    for number, esc in escs.items():
        known[number] = esc
        if esc.rpm is None:
            continue
        said = len(esc.rpm)
        speeds = believable(esc.rpm)
        lost = said - len(speeds or ())
        if lost > WORTH_A_NOTE * said:
            notes.append(
                f"ESC {number}: {lost} of {said} speeds are marks of unknown or lost "
                "frames: left out"
            )
        known[number] = replace(esc, rpm=speeds)
    copies = _repeated(known)
    if copies:
        first = _listed(set(copies.values()))
        notes.append(
            f"ESC {_listed(copies)}: the same numbers as ESC {first}, sent twice: left out"
        )
        for number in copies:
            del known[number]
    return known, notes


def believable(rpm: Series) -> Series | None:
    """Speeds [rpm] without sign, marks and lost frames left out; None where nothing is left."""
    speed = rpm.values[:, 0]
    with np.errstate(invalid="ignore"):
        good = np.isfinite(speed) & (np.abs(speed) <= FASTEST_RPM)
    good &= ~np.isin(speed, UNKNOWN_RPM)
    backwards = speed < 0.0
    turning = good & (speed != 0.0)
    if turning.any() and backwards[turning].mean() < REVERSED_SHARE:
        good &= ~backwards
    kept = Series(rpm.t_s[good], np.abs(rpm.values[good]), rpm.source)
    lost = _lost_frames(kept) | _spikes(kept)
    kept = kept.rows(~lost)
    return kept if len(kept) else None


def _spikes(rpm: Series) -> Mask:
    """Speeds (n,) above ``SPIKE`` times the median of themselves and two neighbours each side, all turning."""
    speed = rpm.values[:, 0]
    if len(speed) < FEWEST_SAMPLES:
        return np.zeros(len(speed), bool)
    around = sliding_window_view(np.pad(speed, 2, mode="edge"), 5)
    median = np.median(around, axis=1)
    return np.asarray((median > 0.0) & (speed > SPIKE * median))


def _lost_frames(rpm: Series) -> Mask:
    """Zeros (n,) between two speeds that are no further apart than ``LOST_S``, where they come often."""
    speed = rpm.values[:, 0]
    turning = np.flatnonzero(speed > 0.0)
    lost = np.zeros(len(speed), bool)
    zeros = np.flatnonzero(speed == 0.0)
    if not turning.size or not zeros.size:
        return lost
    zeros = zeros[(zeros > turning[0]) & (zeros < turning[-1])]
    after = np.searchsorted(turning, zeros)
    apart_s = rpm.t_s[turning[after]] - rpm.t_s[turning[after - 1]]
    lost[zeros] = apart_s <= LOST_S
    often = lost.sum() > LOST_SHARE * len(turning)
    return np.asarray(lost & often)


def _repeated(escs: Mapping[int, EscRecord]) -> dict[int, int]:
    """ESC numbers that only repeat another one, by that one: a batch is a copy as a whole, or not at all."""
    batches: dict[int, list[int]] = {}
    for number, esc in escs.items():
        if esc.rpm is not None:
            batches.setdefault((number - 1) // BATCH, []).append(number)
    first = batches.pop(0, [])
    if len(first) < 2 or _copies(escs, first[0], first[1]):
        return {}  # one motor says nothing, and a log in which all are alike is another fault
    out: dict[int, int] = {}
    for batch, numbers in batches.items():
        pairs = {n: n - batch * BATCH for n in numbers}
        if all(old in first and _copies(escs, old, new) for new, old in pairs.items()):
            out |= pairs
    return out


def _copies(escs: Mapping[int, EscRecord], old: int, new: int) -> bool:
    """Whether one ESC's speeds are another one's, sample by sample."""
    first = _speeds(escs[old])
    second = _speeds(escs[new])
    length = min(len(first), len(second))
    if length < FEWEST_SAMPLES or np.ptp(first) == 0.0:
        return False
    # A batch more or less at the beginning moves the one against the other.
    at_the_end = np.mean(first[-length:] == second[-length:])
    at_the_start = np.mean(first[:length] == second[:length])
    return bool(max(at_the_end, at_the_start) >= SAME_SHARE)


def _speeds(esc: EscRecord) -> Array:
    if esc.rpm is None:
        return np.empty(0)
    return esc.rpm.values[:, 0]


def _listed(numbers: Iterable[int]) -> str:
    return ", ".join(map(str, sorted(numbers)))
