"""Reads an ArduPilot dataflash log (.BIN) into rows, by pymavlink's DFReader. Times: TimeUS, in old logs TimeMS."""

from __future__ import annotations

import contextlib
import io
import math
import os
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from models.errors import LogError
from replay.flightlog import FlightLog
from replay.logs.files import size_of

MAGIC = b"\xa3\x95"
IMUS = ("IMU", "IMU2", "IMU3")
EKF = ("XKF1", "NKF1", "EKF1")
"""Filter output, newest name first: EKF3, EKF2, and EKF1 of old logs."""
ESCS = ("ESC", *(f"ESC{i}" for i in range(1, 33)))
_KINDS = {
    "ATT", "XKQ", "NKQ", *IMUS, *EKF, "RCOU", "BAT", "CURR", "BARO", "RFND", *ESCS, "RPM", "MODE", "EV", "ARM",
    "PARM", "MSG", "CTUN", "VIBE",
}  # fmt: skip
Row = Mapping[str, Any]
"""The fields of one message, and ``t_s``, its boot time [s]."""


@dataclass(frozen=True)
class Dataflash:
    """What a file held. ``rows`` by message name; a name without rows gives an empty list."""

    path: Path
    bytes: int
    rows: Mapping[str, list[Row]]
    counts: Mapping[str, int]
    """Messages of every name, also of those that are not read."""
    damaged: bool


def read(path: Path, target_system: int | None = None) -> list[FlightLog]:
    """The one boot in the file. ``target_system`` is for links; a dataflash log holds one vehicle."""
    from replay.logs.bin_flightlog import flightlog

    size = size_of(path, MAGIC, "ArduPilot dataflash log")
    data = _rows(path, size)
    if not data.rows:
        raise LogError(
            f"{path}: holds no flight data (no ATT, IMU or XKF1): record with LOG_DISARMED or arm the vehicle"
        )
    try:
        return [flightlog(data)]
    except (KeyError, ValueError, TypeError, OverflowError) as error:
        raise LogError(f"{path}: its messages make no sense ({type(error).__name__}: {error}); damaged?") from None


def _rows(path: Path, size: int) -> Dataflash:
    from pymavlink import DFReader

    rows: dict[str, list[Row]] = defaultdict(list)
    counts: dict[str, int] = defaultdict(int)
    last, damaged = math.nan, False
    with _silence():
        try:
            reader: Any = DFReader.DFReader_binary(str(path), zero_time_base=True)
            # recv_match(type=...) would be faster, but its index gives up at the first damage; this goes on behind it.
            while (message := reader.recv_msg()) is not None:
                kind = message.get_type()
                counts[kind] += 1
                if kind not in _KINDS:
                    continue
                row = message.to_dict()
                # Old events and texts carry no time: they are as old as the message before them.
                last = row["t_s"] = _stamp(row, last)
                rows[kind].append(row)
        except Exception as error:  # DFReader raises whatever a damaged file makes of it
            if not rows:
                raise LogError(f"{path}: cannot be read as a dataflash log ({error})") from None
            damaged = True
    return Dataflash(path, size, rows, counts, damaged)


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """DFReader complains of every damaged byte, its C part past sys.stdout and sys.stderr: close both for a while."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = os.dup(1), os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            yield
    finally:
        os.dup2(kept[0], 1)
        os.dup2(kept[1], 2)
        for fd in (*kept, nowhere):
            os.close(fd)


def _stamp(row: Row, last: float) -> float:
    """Boot time [s]. GPS messages reuse TimeMS for the time of week; none of them is read here."""
    if "TimeUS" in row:
        return float(row["TimeUS"]) / 1e6
    return float(row["TimeMS"]) / 1e3 if "TimeMS" in row else last
