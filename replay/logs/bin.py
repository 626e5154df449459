"""Reads an ArduPilot dataflash log (.BIN) into columns, by pymavlink's DFReader. Times: TimeUS, in old logs TimeMS."""

from __future__ import annotations

import contextlib
import io
import math
import os
import sys
from array import array
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from models.errors import LogError
from replay.flightlog import FlightLog
from replay.logs.columns import Messages, believable
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


@dataclass(frozen=True)
class Dataflash:
    """What a file held, by message name."""

    path: Path
    bytes: int
    kinds: Mapping[str, Messages]
    texts: tuple[tuple[float, str], ...]
    """MSG: time [s], text."""
    parameters: Mapping[str, float]
    whole: frozenset[tuple[str, str]]
    """(message, field) whose values are stored as whole numbers."""
    counts: Mapping[str, int]
    """Messages of every name, also of those that are not read."""
    damaged: bool

    def of(self, kind: str) -> Messages:
        """All messages of a name; none where there are none."""
        return self.kinds.get(kind) or Messages(kind, np.empty(0), {})


class _Collector:
    """Takes rows in, gives columns out: eight bytes a number; a row of Python objects takes twenty times as much."""

    def __init__(self) -> None:
        self.times: dict[str, array[float]] = defaultdict(lambda: array("d"))
        self.columns: dict[str, dict[str, array[float]]] = defaultdict(dict)
        self.whole: set[tuple[str, str]] = set()
        self.texts: list[tuple[float, str]] = []
        self.parameters: dict[str, float] = {}

    def add(self, kind: str, row: Mapping[str, Any], t_s: float) -> None:
        """One message. Fields that only some messages of a kind have are NaN in the others."""
        if kind == "MSG":
            self.texts.append((t_s, str(row.get("Message", ""))))
            return
        if kind == "PARM":
            value = float(row.get("Value", math.nan))
            self.parameters |= {str(row["Name"]): value} if math.isfinite(value) else {}
            return
        times, columns = self.times[kind], self.columns[kind]
        for name, value in row.items():
            if not isinstance(value, int | float):
                continue
            if name not in columns:
                columns[name] = array("d", [math.nan]) * len(times)
                self.whole |= {(kind, name)} if isinstance(value, int) else set()
            columns[name].append(value)
        times.append(t_s)
        for column in columns.values():
            if len(column) < len(times):
                column.append(math.nan)

    def kinds(self) -> dict[str, Messages]:
        """Every kind that came."""
        return {
            kind: Messages(
                kind, believable(np.frombuffer(times)), {n: np.frombuffer(c) for n, c in self.columns[kind].items()}
            )
            for kind, times in self.times.items()
        }


def read(path: Path, target_system: int | None = None) -> list[FlightLog]:
    """The one boot in the file. ``target_system`` is for links; a dataflash log holds one vehicle."""
    from replay.logs.bin_flightlog import flightlog

    data = _collected(path, size_of(path, MAGIC, "ArduPilot dataflash log"))
    if not data.kinds:
        raise LogError(
            f"{path}: holds no flight data (no ATT, IMU or XKF1): record with LOG_DISARMED or arm the vehicle"
        )
    try:
        return [flightlog(data)]
    except (KeyError, ValueError, TypeError, OverflowError) as error:
        raise LogError(f"{path}: its messages make no sense ({type(error).__name__}: {error}); damaged?") from None


def _collected(path: Path, size: int) -> Dataflash:
    from pymavlink import DFReader

    rows, counts = _Collector(), Counter[str]()
    last, damaged = math.nan, False
    with _silence():
        try:
            reader: Any = DFReader.DFReader_binary(str(path), zero_time_base=True)
            # recv_match(type=...) would be faster, but its index gives up at the first damage; this goes on behind it.
            while (message := reader.recv_msg()) is not None:
                kind = message.get_type()
                counts[kind] += 1
                if kind in _KINDS:
                    row = message.to_dict()
                    # Old events and texts carry no time: they are as old as the message before them.
                    last = _stamp(row, last)
                    rows.add(kind, row, last)
        except MemoryError:
            raise
        except Exception as error:  # DFReader raises whatever a damaged file makes of it
            if not rows.times:
                raise LogError(f"{path}: cannot be read as a dataflash log ({error})") from None
            damaged = True
    return Dataflash(
        path, size, rows.kinds(), tuple(rows.texts), rows.parameters, frozenset(rows.whole), counts, damaged
    )


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


def _stamp(row: Mapping[str, Any], last: float) -> float:
    """Boot time [s]. GPS messages reuse TimeMS for the time of week; none of them is read here."""
    if "TimeUS" in row:
        return float(row["TimeUS"]) / 1e6
    return float(row["TimeMS"]) / 1e3 if "TimeMS" in row else last
