"""The companion's messages are decoded and encoded by its own dialect, whatever MAVLINK_DIALECT says."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from patience import HANG_S

_PROGRAM = """
import os, socket, time
if {parent_imported}:
    from pymavlink import mavutil
from companion.mavlink.esc_messages import ESC_STATUS
from companion.mavlink.wire_frames import pack
from companion.mavlink.link import Arrivals, open_link
from companion.mavlink.message_filter import Intake
from companion.mavlink.outgoing import command_long
from companion.mavlink.dialect import mavlink

with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
    probe.bind(("127.0.0.1", 0))
    port = probe.getsockname()[1]
link = open_link(f"udpin:127.0.0.1:{{port}}", Arrivals())
peer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
beat = mavlink.MAVLink_heartbeat_message(2, 12, 128, 6 << 16, 4, 3)
peer.sendto(beat.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1)), ("127.0.0.1", port))
speeds = ESC_STATUS.unpacker.pack(20_000_000, *[4000] * 4, *[16.0] * 4, *[5.0] * 4, 0)
peer.sendto(pack(ESC_STATUS.id, speeds, 1, 1, 0), ("127.0.0.1", port))
intake, seen, end = Intake(), [], time.monotonic() + 300.0
while len(seen) < 2 and time.monotonic() < end:
    for arrival_us, frame in link.drain():
        seen.append(type(intake.sample(frame, arrival_us)).__name__)
link.send(*command_long(1, 1, 511, 291.0, 40000.0))
peer.settimeout(300.0)
print(seen, peer.recv(300)[0] == 0xFD, os.environ.get("MAVLINK_DIALECT"))
"""


@pytest.mark.parametrize("parent_imported", [False, True])
@pytest.mark.parametrize("dialect", ["common", "all", "minimal"])
def test_esc_status_is_decoded_and_requests_are_sent(dialect, parent_imported):
    environment = {**os.environ, "MAVLINK_DIALECT": dialect}
    program = _PROGRAM.format(parent_imported=parent_imported)
    answer = subprocess.run(
        [sys.executable, "-c", program],
        env=environment,
        capture_output=True,
        text=True,
        timeout=HANG_S,
        check=False,
    )
    assert answer.stderr == ""
    assert answer.stdout.strip() == f"['Heartbeat', 'RotorSpeeds'] True {dialect}"


def test_a_dialect_that_does_not_exist_does_no_harm():
    environment = {**os.environ, "MAVLINK_DIALECT": "nonsense"}
    program = _PROGRAM.format(parent_imported=False)
    answer = subprocess.run(
        [sys.executable, "-c", program],
        env=environment,
        capture_output=True,
        text=True,
        timeout=HANG_S,
        check=False,
    )
    assert answer.stdout.startswith("['Heartbeat', 'RotorSpeeds'] True"), answer.stderr
