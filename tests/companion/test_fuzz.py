"""Any bytes through the live decoder and the flight program: no exception, and nothing unsound is sent."""

from __future__ import annotations

import random
import struct
import warnings

import numpy as np
import pytest
from flying import CONFIG
from hypothesis import given, settings
from hypothesis import strategies as st
from log_writers import bin_flight, ulg_flight
from safety.fuzz import RAW, Limits, check_sound, log_kinds, proper_frame, records, sound_flight
from safety.fuzz_logs import ulg_kind

from companion.mavlink.message_filter import Intake
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.wire_frames import FrameReader
from companion.pipeline import initial_state, step
from models.common.errors import LogError
from models.common.progress import Bars
from replay.logs.columns import Messages, believable, quaternions, unflipped
from replay.logs.formats import load

NUMBERS = sorted(LAYOUTS)


def run(pieces: list[bytes]) -> int:
    reader, intake, state, now_us, seen = FrameReader(), Intake(), initial_state(CONFIG), 10**15, 0
    for piece in pieces:
        now_us += 20_000
        for frame in reader.feed(piece):
            sample = intake.sample(frame, now_us)
            if sample is None:
                continue
            state, decision = step(state, sample, CONFIG)
            seen += decision is not None
            if decision is not None:
                check_sound(decision.command)
    return seen


@given(st.lists(st.binary(max_size=300), max_size=10))
@settings(max_examples=60, deadline=None)
def test_any_bytes_between_a_sound_flight(junk):
    pieces = [
        part
        for k, some in enumerate(junk)
        for part in (some, sound_flight(2 * k), sound_flight(2 * k + 1))
    ]
    run(pieces)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_proper_frames_of_any_content_and_damaged_ones(seed):
    rng = random.Random(seed)
    pieces = []
    for k in range(12):
        raw = proper_frame(rng.choice(NUMBERS), rng)
        if rng.random() < 0.5:
            raw = bytes(rng.choice(RAW)(bytearray(raw), rng))
        pieces += [raw, sound_flight(k)]
    run(pieces)


def test_the_sound_flight_brings_decisions():
    assert run([sound_flight(k) for k in range(20)]) > 10


def test_times_that_no_clock_shows_are_none_without_a_warning():
    """Found by the fuzzer: stamps of 1e300 s in a damaged log."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        out = believable(np.array([1e300, 1e300, np.inf, np.nan, -1.0]))
        assert np.isnan(out).all()
        assert believable(np.array([1.0, 1.02, 1e300])).tolist()[:2] == [1.0, 1.02]


@pytest.mark.parametrize("kind", log_kinds(), ids=lambda kind: kind.suffix)
def test_mutated_records_of_a_log_are_read_or_refused_without_a_warning(kind, tmp_path):
    limits = Limits(seed=5, hang_s=60.0, keep=tmp_path / "failures", bars=Bars())
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        counts = records(3000, limits, kind)
    assert counts.failures == []
    assert counts.inputs >= 3000
    assert counts.samples > 0


def test_numbers_that_a_damaged_log_holds_are_none_without_a_warning():
    """Found by the fuzzer: infinite angles, a quaternion with an infinite part, a NaN that signals."""
    signalling = np.array([0x7F800001, 0x3F800000], np.uint32).view(np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert (
            np.isnan(quaternions(np.array([[np.inf, 0.0, 0.0], [0.1, 0.2, -np.inf]])))
            .all(axis=1)
            .all()
        )
        assert np.isnan(
            unflipped(np.array([[np.inf, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, np.nan]]))
        ).all()
        column = Messages("any", np.zeros(2), {"value": signalling}).column("value")
    assert np.isnan(column[0])
    assert column[1] == 1.0


@pytest.mark.parametrize("columns", ["TimeUS,Name,Walue", "TimeUS,Mame,Value", "TimeUS,Value,Name"])
def test_parameters_whose_declaration_is_damaged_are_left_out(columns, tmp_path):
    """Found by the fuzzer: FMT of PARM with a name changed."""
    path = tmp_path / "flight.bin"
    path.write_bytes(bin_flight().replace(b"TimeUS,Name,Value", columns.encode()))
    assert load(path)[0].parameters == {}


@pytest.mark.slow
def test_a_ulg_whose_last_length_points_beyond_its_end_is_refused_and_read_no_longer(tmp_path):
    """Found by the fuzzer: pyulog goes back by a length that it could not read, and comes by the same place again."""
    sound = ulg_kind(ulg_flight())
    formats = [record for record in sound.definitions if record[2] == ord("F")]
    long = struct.pack("<HB", 200, ord("F")) + b"x:" + bytes(198)
    path = tmp_path / "flight.ulg"
    path.write_bytes(
        sound.head + b"".join(formats) + 320 * long + struct.pack("<HB", 60_000, 1) + bytes(10)
    )
    with pytest.raises(LogError, match="holds no vehicle_attitude"):
        load(path)
