"""Rotor speeds that cannot be, in all formats: marks of unknown, lost frames, batches that are sent twice."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from log_writers import EPOCH_US, BinWriter, frame, heartbeat, write_tlog

from companion.mavlink.dialect import mavlink
from companion.mavlink.esc_messages import ESC_STATUS
from companion.mavlink.wire_frames import pack
from models.common.frames import Array
from replay.flightlog import EscRecord, Series
from replay.logs.formats import load
from replay.logs.rotor_speeds import believable, believable_escs

SAMPLES = 60
STEP_S = 0.1
EVERY = 3


def speeds(number: int) -> Array:
    """Of ESC ``number`` (from 1): 5000 rpm and what it varies by."""
    return np.round(5000.0 + 100.0 * number + 50.0 * np.sin(np.arange(SAMPLES)))


def with_mark(values: Array, mark: float) -> Array:
    """Every third sample unknown."""
    out = values.copy()
    out[::EVERY] = mark
    return out


def tlog(path: Path, third: Array, *, status: bool = False) -> None:
    messages = []
    count = itertools.count()
    for k in range(SAMPLES):
        us = int(1e6 * STEP_S) * k
        rpm = [speeds(1)[k], speeds(2)[k], third[k], speeds(4)[k]]
        whole = [int(v) for v in rpm]
        if status:
            raw = ESC_STATUS.unpacker.pack(us, *whole, *[16.0] * 4, *[5.0] * 4, 0)
            esc = pack(ESC_STATUS.id, raw, 1, 1, next(count) % 256)
        else:
            message = mavlink.MAVLink_esc_telemetry_1_to_4_message(
                [40] * 4, [1600] * 4, [500] * 4, [0] * 4, whole, [k % 65536] * 4
            )
            esc = frame(message, sequence=next(count) % 256)
        beat = frame(heartbeat(), sequence=next(count) % 256)
        attitude = mavlink.MAVLink_attitude_message(us // 1000, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        here = frame(attitude, sequence=next(count) % 256)
        messages += [(EPOCH_US + us, raw) for raw in (beat, here, esc)]
    write_tlog(path, messages)


def dataflash(path: Path, third: Array, batches: int = 1) -> None:
    w = BinWriter()
    w.kind("ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    w.kind("ESC", "QBfff", "TimeUS,Instance,RPM,Volt,Temp")
    for k in range(SAMPLES):
        us = 10_000_000 + int(1e6 * STEP_S) * k
        w.row("ATT", us, *[0.0] * 6)
        for batch in range(batches):
            rpm = (speeds(1)[k], speeds(2)[k], third[k], speeds(4)[k])
            for slot, value in enumerate(rpm):
                w.row("ESC", us + batch, 4 * batch + slot, value, 16.0, 40.0)
    path.write_bytes(w.bytes())


@pytest.mark.parametrize("mark", [65535, 0])
def test_a_mark_now_and_then_in_a_tlog_is_unknown(tmp_path: Path, mark: int) -> None:
    path = tmp_path / "a.tlog"
    tlog(path, with_mark(speeds(3), mark))
    rpm = load(path)[0].escs[3].rpm
    assert rpm is not None
    assert float(rpm.values.max()) < 5400.0
    assert float(rpm.values[1:].min()) > 5200.0


@pytest.mark.parametrize("mark", [65535, -1, 2**31 - 1, -(2**31)])
def test_a_mark_now_and_then_of_a_signed_message_is_unknown(tmp_path: Path, mark: int) -> None:
    path = tmp_path / "a.tlog"
    tlog(path, with_mark(speeds(3), mark), status=True)
    rpm = load(path)[0].escs[3].rpm
    assert rpm is not None
    assert 5200.0 < float(rpm.values.min()) <= float(rpm.values.max()) < 5400.0


@pytest.mark.parametrize("mark", [65535.0, -1.0, 2.0**31, np.nan, np.inf, 65535.0 * 100.0 / 7.0])
def test_a_mark_now_and_then_in_dataflash_is_unknown(tmp_path: Path, mark: float) -> None:
    path = tmp_path / "a.bin"
    dataflash(path, with_mark(speeds(3), mark))
    rpm = load(path)[0].escs[3].rpm
    assert rpm is not None
    assert len(rpm) == SAMPLES - SAMPLES // EVERY
    assert 5200.0 < float(rpm.values.min()) <= float(rpm.values.max()) < 5400.0


def test_an_esc_that_never_tells_has_no_speed(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    dataflash(path, np.full(SAMPLES, 65535.0))
    log = load(path)[0]
    assert log.escs[3].rpm is None
    assert log.escs[3].temperature_c is not None
    assert any("ESC 3: 60 of 60 speeds are" in note for note in log.summary.notes)


def series(values: Array) -> Series:
    return Series(STEP_S * np.arange(len(values)), values[:, None])


def test_a_rotor_that_turns_backwards_has_a_speed() -> None:
    found = believable(series(-speeds(1)))
    assert found is not None
    np.testing.assert_array_equal(found.values[:, 0], speeds(1))


def test_a_rotor_that_stops_stays_stopped() -> None:
    stops = speeds(1)
    stops[20:40] = 0.0
    stops[50:] = 0.0
    found = believable(series(stops))
    assert found is not None
    assert len(found) == SAMPLES


def test_a_batch_that_is_sent_twice_counts_once(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    dataflash(path, speeds(3), batches=2)
    log = load(path)[0]
    assert sorted(log.escs) == [1, 2, 3, 4]
    assert any(
        "ESC 5, 6, 7, 8: the same numbers as ESC 1, 2, 3, 4" in note for note in log.summary.notes
    )


def test_eight_rotors_are_eight() -> None:
    escs = {number: EscRecord(series(speeds(number))) for number in range(1, 9)}
    found, notes = believable_escs(escs)
    assert sorted(found) == list(range(1, 9))
    assert not notes


def test_speeds_that_are_all_alike_are_no_second_batch() -> None:
    """They are a fault of their own."""
    escs = {number: EscRecord(series(speeds(1))) for number in range(1, 9)}
    found, _ = believable_escs(escs)
    assert sorted(found) == list(range(1, 9))
