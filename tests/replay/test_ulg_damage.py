"""Cut and damaged PX4 logs: what is whole is read, what is lost is said."""

from __future__ import annotations

import random
import struct
from pathlib import Path

import pytest
from log_writers import UlgWriter, ulg_flight

from models.common.errors import LogError
from replay.flightlog import FlightLog
from replay.logs.formats import load
from replay.logs.ulg_repair import repaired

pytest.importorskip("pyulog")
WHOLE = ulg_flight(20.0)
SAMPLES = 1000


def read(path: Path, data: bytes) -> FlightLog:
    """The only boot of a log."""
    (path / "flight.ulg").write_bytes(data)
    (log,) = load(path / "flight.ulg")
    return log


def test_a_sound_log_is_left_alone():
    assert repaired(WHOLE).data is WHOLE
    assert repaired(WHOLE).notes == ()


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("cut", [0, 1, 2, 3])
def test_a_cut_log_gives_what_it_holds_and_says_so(share, cut, tmp_path):
    log = read(tmp_path, WHOLE[: round(share * len(WHOLE)) - cut])
    assert len(log.attitude) == pytest.approx(share * SAMPLES, abs=25)
    assert all("cut off" in note for note in log.summary.notes)


def test_a_cut_within_a_message_is_said(tmp_path):
    log = read(tmp_path, WHOLE[:-7])
    assert any("last message cut off" in note for note in log.summary.notes)


@pytest.mark.parametrize("seed", range(20))
def test_one_flipped_bit_costs_a_message_or_two(seed, tmp_path):
    rng = random.Random(seed)
    data = bytearray(WHOLE)
    data[rng.randrange(2000, len(data))] ^= 1 << rng.randrange(8)
    log = read(tmp_path, bytes(data))
    assert len(log.attitude) >= SAMPLES - 3
    assert len(log.imus[0].gyro) >= SAMPLES - 3


def hole(data: bytearray, at: int, rng: random.Random) -> None:
    data[at : at + 3000] = rng.randbytes(3000)


def missing(data: bytearray, at: int, _: random.Random) -> None:
    del data[at : at + 777]


def zeros(data: bytearray, at: int, _: random.Random) -> None:
    data[at : at + 4096] = bytes(4096)


@pytest.mark.parametrize("damage", [hole, missing, zeros])
@pytest.mark.parametrize("seed", range(4))
def test_damage_in_the_midst_costs_what_it_hits_and_is_said(damage, seed, tmp_path):
    rng = random.Random(seed)
    data = bytearray(WHOLE)
    damage(data, rng.randrange(len(data) // 4, len(data) - 5000), rng)
    log = read(tmp_path, bytes(data))
    assert len(log.attitude) > SAMPLES - 30
    assert log.end_s == pytest.approx(39.98)
    assert any("damaged bytes skipped in 1 places" in note for note in log.summary.notes)


def test_zeros_to_the_end_are_said(tmp_path):
    half = len(WHOLE) // 2
    log = read(tmp_path, WHOLE[:half] + bytes(half))
    assert len(log.attitude) == pytest.approx(SAMPLES / 2, abs=25)
    assert any("damaged bytes skipped" in note for note in log.summary.notes)


def test_text_that_is_no_text_costs_its_message(tmp_path):
    """pyulog refuses a log for one such byte."""
    at = WHOLE.index(b"MPC_THR_HOVER")
    data = bytearray(WHOLE)
    data[at] = 0xFF
    log = read(tmp_path, bytes(data))
    assert len(log.attitude) == SAMPLES
    assert log.parameters == {}
    assert log.summary.notes


def test_data_that_was_appended_is_no_damage():
    """After a crash PX4 appends what it knows of it; the place is in the flags, and a message before it may be cut."""
    data = bytearray(WHOLE)
    offset = len(data) - 5
    del data[offset:]
    report = b"\x00\x1bchar[17424] hardfault_plain" + b"x" * 17424
    data += struct.pack("<HB", len(report), ord("M")) + report
    data[19 + 8] = 1
    data[19 + 16 : 19 + 24] = struct.pack("<Q", offset)
    found = repaired(bytes(data))
    assert found.data.endswith(report)
    assert len(found.data) > len(WHOLE) - 200 + len(report)


def test_no_bytes_crash_the_reader(tmp_path):
    for seed in range(30):
        rng = random.Random(seed)
        data = bytearray(ulg_flight(1.0))
        for _ in range(rng.randrange(1, 200)):
            data[rng.randrange(8, len(data))] = rng.randrange(256)
        try:
            read(tmp_path, bytes(data))
        except LogError as error:
            assert "\n" not in str(error)  # noqa: PT017 - what is left may also be a log


# --- orientation ------------------------------------------------------------------------------------------------------


def with_sensor(quaternions: list[tuple[float, ...]], distance: float = 1.5) -> bytes:
    """A rangefinder with a custom orientation (100); one quaternion a sample, the last for the rest."""
    w = UlgWriter()
    w.topic("vehicle_attitude", ("float[4]", "q"))
    w.topic(
        "distance_sensor", ("float", "min_distance"), ("float", "max_distance"), ("float", "current_distance"),
        ("float", "variance"), ("float[4]", "q"), ("int8_t", "signal_quality"), ("uint8_t", "orientation"),
    )  # fmt: skip
    w.subscribe()
    for k in range(100):
        us = 20_000_000 + 20_000 * k
        w.row("vehicle_attitude", us, 1.0, 0.0, 0.0, 0.0)
        q = quaternions[min(k, len(quaternions) - 1)]
        w.row("distance_sensor", us, 0.1, 4.0, distance, 0.0004, *q, -1, 100)
    return w.bytes()


DOWN = (0.5**0.5, 0.0, -(0.5**0.5), 0.0)
"""Pitch -90 degrees."""
NONE = (0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    "quaternions", [[DOWN], [DOWN, NONE], [NONE, DOWN], [(float("nan"),) * 4, DOWN, NONE]]
)
def test_a_sensor_with_a_quaternion_looks_where_it_says(quaternions, tmp_path):
    beam = read(tmp_path, with_sensor(quaternions)).beam("down")
    assert beam is not None
    assert len(beam.good) == 100


def test_a_sensor_whose_quaternion_says_nothing_is_ignored_and_said(tmp_path):
    log = read(tmp_path, with_sensor([NONE]))
    assert log.beams == ()
    assert any("cannot be resolved" in note for note in log.summary.notes)


def test_no_reading_is_nothing_whatever_the_orientation(tmp_path):
    beam = read(tmp_path, with_sensor([DOWN], distance=655.35)).beam("down")
    assert beam is not None
    assert len(beam.good) == 0
