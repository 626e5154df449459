"""The walk of whole files gives what the walk of a link gives, on good and on damaged data."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.mavlink import frame_batch
from companion.mavlink.frame_batch import walk_file
from companion.mavlink.frames import CRC_EXTRAS, Counts, pack, walk

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"


def recording(frames: int, seed: int) -> bytes:
    """Stamps and frames of all lengths and of both versions, some signed, some of an unknown message."""
    rng, out = random.Random(seed), bytearray()
    for k in range(frames):
        number = rng.choice([*CRC_EXTRAS, 60_000])
        payload = rng.randbytes(rng.choice([1, 9, 28, 40, 200, 255]))
        out += rng.randbytes(8)
        if number in CRC_EXTRAS:
            signed = rng.random() < 0.2
            out += pack(number, payload, 1, 1, k, signed=signed) + (rng.randbytes(13) if signed else b"")
        else:
            out += bytes([0xFD, len(payload), 0, 0, k & 255, 1, 1]) + number.to_bytes(3, "little") + payload + b"ab"
    return bytes(out)


def same(data: bytes) -> None:
    ours, theirs = Counts(), Counts()
    assert walk_file(data, ours, 8) == walk(data, theirs, 8)
    assert ours == theirs


@pytest.fixture(autouse=True)
def _small_blocks(monkeypatch):
    monkeypatch.setattr(frame_batch, "_ONE_BY_ONE", 4)
    monkeypatch.setattr(frame_batch, "_BLOCK", 32)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), max_size=6), st.floats(0, 1))
def test_damaged_data_give_the_same_frames(seed, spots, kept):
    data = bytearray(recording(120, seed))
    for place, value in spots:
        data[int(place * (len(data) - 1))] = value
    same(bytes(data[: int(kept * len(data))]))
    same(bytes(data))


def test_every_length_and_message_passes_its_checksum():
    rng = random.Random(5)
    payloads = [rng.randbytes(size - 1) + b"x" for size in range(1, 256)]
    frames = [b"8 bytes " + pack(number, payloads[k % 255], 1, 1, k) for k, number in enumerate([*CRC_EXTRAS] * 3)]
    starts, _ = walk_file(b"".join(frames), Counts(), 8)
    assert len(starts) == len(frames)


@pytest.mark.skipif(not DATA.exists(), reason="needs the recordings in ../shared/data")
@pytest.mark.parametrize("name", ["ardupilot", "open", "undeclared"])
def test_recordings_give_the_same_frames(name):
    for path in sorted((DATA / name).glob("*.tlog")):
        data = path.read_bytes()[:600_000]
        same(data)
        same(data[: len(data) // 2] + data[len(data) // 2 + 5 :])


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.floats(0, 1))
def test_frames_inside_payloads_are_no_frames_of_the_log(seed, kept):
    # A tunnel, or a log that is sent as a file: stamped frames one after another within the payloads of others.
    rng, inner = random.Random(seed), recording(400, seed)
    out, at = bytearray(), 0
    while at < len(inner):
        size = rng.choice([60, 120, 250])
        out += b"8 bytes " + pack(385, inner[at : at + size], 1, 1, at & 255)
        at += size
    same(bytes(out))
    same(bytes(out[: int(kept * len(out))]))
