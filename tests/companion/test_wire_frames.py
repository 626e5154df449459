"""Frames out of bytes: the same as pymavlink's, in any pieces, after any damage; signatures as pymavlink makes them."""

import itertools
import random
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.mavlink.boot_clock import BootClock
from companion.mavlink.dialect import mavlink
from companion.mavlink.file_frames import cut_file
from companion.mavlink.message_table import LAYOUTS, decode
from companion.mavlink.setpoints import AttitudeCommand, PositionCommand, encode
from companion.mavlink.signing import Signatures
from companion.mavlink.wire_frames import V1, V2, Counts, FrameReader, cut, pack, unpacked, walk

MESSAGES = [
    mavlink.MAVLink_heartbeat_message(2, 3, 137, 4, 4, 3),
    mavlink.MAVLink_attitude_message(42_200, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6),
    mavlink.MAVLink_local_position_ned_message(42_200, 1, 2, 3, 0, 0, 0),
    mavlink.MAVLink_statustext_message(4, b"hello"),
    mavlink.MAVLink_distance_sensor_message(42_200, 5, 800, 40, 0, 1, 25, 0),
    mavlink.MAVLink_vfr_hud_message(0, 0, 0, 0, 0, 0),
]


def packed(message, *, v1=False, system=1):
    link = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
    return bytes(message.pack(link, force_mavlink1=v1))


STREAM = [packed(m, v1=v1) for v1 in (False, True) for m in MESSAGES]


@pytest.mark.parametrize("raw", STREAM)
def test_a_frame_says_what_pymavlink_says(raw):
    theirs = mavlink.MAVLink(None).parse_buffer(raw)[0]
    (ours,) = FrameReader().feed(raw)
    assert (ours.id, ours.system, ours.component) == (
        theirs.get_msgId(), theirs.get_srcSystem(), theirs.get_srcComponent()
    )  # fmt: skip
    assert ours.raw == raw
    layout = LAYOUTS.get(ours.id)
    if layout is None:
        assert decode(ours, 0, BootClock()) is None
        return
    fields = unpacked(ours.id, ours.payload)
    for name, place in layout.wire.places.items():
        value = getattr(theirs, name)
        if isinstance(value, str):
            assert fields[place.start].rstrip(b"\0").decode() == value
        else:
            assert fields[place] == tuple(value if isinstance(value, list | tuple) else [value])


@given(st.lists(st.sampled_from(STREAM), max_size=8), st.lists(st.integers(0, 300), max_size=12))
def test_pieces_do_not_matter(frames, cuts):
    data, reader, got = b"".join(frames), FrameReader(), []
    edges = [0, *sorted(c % (len(data) + 1) for c in cuts), len(data)]
    for a, b in itertools.pairwise(edges):
        got += [f.raw for f in reader.feed(data[a:b])]
    assert got == frames
    assert reader.counts.bad_crc == reader.counts.skipped_bytes == 0


@settings(max_examples=200)
@given(
    st.lists(st.sampled_from(STREAM), min_size=3, max_size=8),
    st.binary(max_size=40),
    st.integers(0, 1000),
)
def test_after_damage_the_frames_behind_it_are_found(frames, noise, where):
    """Noise between two frames costs at most what it may hide: never the last frame, once it is followed by more."""
    noise = bytes(b for b in noise if b not in (V1, V2))
    at = where % (len(frames) - 1) + 1
    reader = FrameReader()
    got = [f.raw for f in reader.feed(b"".join(frames[:at]) + noise + b"".join(frames[at:]))]
    assert got == frames
    assert reader.counts.skipped_bytes == len(noise)


@settings(max_examples=200)
@given(
    st.lists(st.one_of(st.sampled_from(STREAM), st.binary(max_size=30)), min_size=1, max_size=12),
    st.integers(0, 2**31),
)
def test_a_file_holds_the_frames_that_a_link_brings(pieces, flip):
    data = bytearray(b"".join([*pieces, STREAM[0]]))
    data[flip % len(data)] ^= 1 << flip % 8
    # Zeros behind it let a link give up on a frame that is longer than what came.
    data += bytes(600) + STREAM[0]
    counts, reader = Counts(), FrameReader()
    found = cut_file(bytes(data), counts, 0)
    brought = reader.feed(bytes(data))
    assert [cut(bytes(data), i) for i in found.start.tolist()] == list(brought)
    assert counts == reader.counts
    assert found.rest == len(data)


def test_a_wrong_checksum_is_counted_and_the_next_frame_read():
    bad = bytearray(STREAM[1])
    bad[14] ^= 1
    reader = FrameReader()
    assert [f.raw for f in reader.feed(bytes(bad) + STREAM[0])] == [STREAM[0]]
    assert reader.counts.bad_crc == 1


@given(st.lists(st.binary(max_size=700), max_size=20))
def test_no_bytes_raise_and_the_rest_stays_small(pieces):
    reader = FrameReader()
    for piece in pieces:
        for frame in reader.feed(piece):
            assert frame.raw
        assert len(reader._rest) < 300


def test_noise_does_not_grow_the_rest():
    reader, noise = FrameReader(), random.Random(3)
    for _ in range(2000):
        list(reader.feed(bytes(noise.choice((V1, V2, 0, 3, 255)) for _ in range(50))))
        assert len(reader._rest) < 300
    assert [f.raw for f in reader.feed(bytes(300) + STREAM[0])] == [STREAM[0]]


def test_a_message_of_another_dialect_is_vouched_for_by_what_follows():
    unlisted = bytes((V2, 2, 0, 0, 1, 1, 1, 0xFF, 0xFF, 0x7F, 9, 9, 0, 0))
    counts = Counts()
    starts, rest = walk(unlisted + STREAM[0], counts)
    assert list(starts) == [0, len(unlisted)]
    assert rest == len(unlisted + STREAM[0])
    assert counts.unknown == 1


@pytest.mark.parametrize("t_s", [0.0, 12.345, 4_300_000.0])
def test_setpoints_are_the_bytes_that_pymavlink_packs(t_s):
    q, rates = (0.5, 0.5, -0.5, 0.5), (0.1, 0.2, 0.3)
    attitude = AttitudeCommand(t_s, q, 0.43, 7, rates)
    place = PositionCommand(t_s, (1.0, 2.0, -3.0), 1.2, (0.1, 0.2, 0.3))
    boot_ms = round(t_s * 1000.0) & 0xFFFFFFFF
    theirs = (
        mavlink.MAVLink_set_attitude_target_message(boot_ms, 3, 1, 7, list(q), *rates, 0.43),
        mavlink.MAVLink_set_position_target_local_ned_message(
            boot_ms, 3, 1, 1, 8 | 16 | 32 | 2048, 1, 2, -3, 0, 0, 0, 0.1, 0.2, 0.3, 1.2, 0
        ),
    )
    for command, message in zip((attitude, place), theirs, strict=True):
        link = mavlink.MAVLink(None, srcSystem=3, srcComponent=191)
        link.seq = 7
        assert pack(*encode(command, 3), 3, 191, 7) == bytes(message.pack(link))


def signer(key=bytes(range(32)), stamp=1_000_000_000):
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    link.signing.secret_key, link.signing.sign_outgoing = key, True
    link.signing.timestamp, link.signing.link_id = stamp, 5
    return link


def test_signatures_are_those_of_pymavlink_both_ways():
    sender, receiver = signer(), signer()
    raw = bytes(MESSAGES[1].pack(sender))
    assert Signatures(receiver.signing).accepts(cut(raw, 0))
    ours = Signatures(signer().signing).sign(
        pack(30, cut(raw, 0).payload, 1, 1, raw[4], signed=True)
    )
    assert ours == raw
    theirs = signer().parse_buffer(ours)
    assert theirs is not None
    assert theirs[0].get_type() == "ATTITUDE"


def test_unsigned_wrong_and_repeated_frames_are_refused_and_counted():
    check = Signatures(signer().signing)
    raw = bytes(MESSAGES[1].pack(signer()))
    assert not check.accepts(cut(STREAM[1], 0)), "not signed"
    assert not check.accepts(cut(packed(MESSAGES[1], v1=True), 0)), "MAVLink 1 cannot be signed"
    assert not check.accepts(cut(bytes(MESSAGES[1].pack(signer(key=bytes(32)))), 0)), "another key"
    assert check.accepts(cut(raw, 0))
    assert not check.accepts(cut(raw, 0)), "sent a second time"
    assert not check.accepts(cut(bytes(MESSAGES[1].pack(signer(stamp=900_000_000))), 0)), "older"
    assert check.refused == 5


def test_the_first_frame_of_a_stream_may_be_a_minute_old():
    for behind, accepted in ((5_900_000, True), (6_100_000, False)):
        raw = bytes(MESSAGES[1].pack(signer(stamp=1_000_000_000 - behind)))
        assert Signatures(signer().signing).accepts(cut(raw, 0)) is accepted


def test_the_published_layout_of_a_signature():
    """Link id, 48 bits of time, then the first 48 bits of SHA-256 over key and everything before."""
    raw = bytes(MESSAGES[1].pack(signer()))
    assert raw[2] == 1
    link_id, low, high = struct.unpack("<BIH", raw[-13:-6])
    assert (link_id, low | high << 32) == (5, 1_000_000_000)
