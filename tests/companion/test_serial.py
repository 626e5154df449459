"""A link on a serial port: frames arrive in pieces at the speed of the wire, and no read waits for the rest of one."""

from __future__ import annotations

import os
import pty
import termios
import threading
import time
import tty

import pytest
from patience import HANG_S

from companion.cli import parser
from companion.mavlink.dialect import mavlink
from companion.mavlink.link import Arrivals, open_link
from companion.mavlink.wire_frames import FrameReader

BITS_A_BYTE = 10  # start and stop bit


@pytest.fixture
def port():
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    yield ours, os.ttyname(theirs)
    os.close(ours)
    os.close(theirs)


def frames(count: int) -> list[bytes]:
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    out = []
    for k in range(count):
        out.append(
            bytes(mav.attitude_quaternion_encode(20_000 + 20 * k, 1, 0, 0, 0, 0.1, 0, 0).pack(mav))
        )
        mav.seq = (mav.seq + 1) % 256
    return out


@pytest.mark.parametrize("baud", [57600, 921600])
def test_frames_in_pieces_are_all_read_and_no_read_blocks(port, baud):
    master, name = port
    link = open_link(name, Arrivals(), baud=baud)
    sent = frames(60)
    wire = b"".join(sent)
    piece = max(baud // BITS_A_BYTE // 1000, 1)  # what arrives in a millisecond

    def send() -> None:
        for i in range(0, len(wire), piece):
            os.write(master, wire[i : i + piece])
            time.sleep(0.001)

    sender = threading.Thread(target=send)
    sender.start()
    got, reads, end = [], 0, time.monotonic() + HANG_S
    while len(got) < len(sent) and time.monotonic() < end:
        got += [frame.raw for _, frame in link.drain()]
        reads += 1
    sender.join()
    link.close()
    assert got == sent
    assert link.bad == 0
    assert reads > len(sent), (
        "a drain returns with what is there instead of waiting for a whole frame"
    )


def test_half_a_frame_is_kept_until_the_rest_comes(port):
    master, name = port
    link = open_link(name, Arrivals(), baud=57600)
    (frame,) = frames(1)
    os.write(master, frame[:17])
    assert drained(link, 5) == []
    os.write(master, frame[17:])
    assert drained(link, 30_000) == [frame]
    link.close()


def drained(link, tries: int) -> list[bytes]:
    for _ in range(tries):
        got = [frame.raw for _, frame in link.drain()]
        if got:
            return got
        time.sleep(0.01)
    return []


@pytest.mark.parametrize(("baud", "speed"), [(57600, termios.B57600), (921600, termios.B921600)])
def test_the_port_runs_at_the_rate_asked_for(port, baud, speed):
    _, name = port
    link = open_link(name, Arrivals(), baud=baud)
    assert termios.tcgetattr(link.fileno)[4] == speed
    link.close()


def test_a_port_runs_at_the_rate_that_a_flight_needs_unless_another_is_asked_for(port):
    _, name = port
    link = open_link(name, Arrivals())
    assert termios.tcgetattr(link.fileno)[4] == termios.B460800
    assert parser().parse_args(["--connect", name]).baud == 460800
    link.close()


def test_a_full_port_drops_frames_instead_of_holding_up_the_flight(port):
    """Nobody reads the other end until the kernel's buffer is full; then what had begun is ended, and frames go on."""
    master, name = port
    link = open_link(name, Arrivals(), baud=57600)
    many = frames(2000)
    for frame in many:
        link.forward(frame)
    assert 0 < link.sent < len(many)
    assert link.dropped == len(many) - link.sent
    first = link.sent
    reader, got = FrameReader(), []
    for frame in [b"", *many[:5]]:
        got += reader.feed(os.read(master, 1 << 16))
        if frame:
            link.forward(frame)
        time.sleep(0.01)
    got += reader.feed(os.read(master, 1 << 16))
    assert reader.counts.bad_crc == 0
    assert reader.counts.skipped_bytes == 0, "no frame is cut in two by another"
    assert len(got) == link.sent > first
    link.close()
