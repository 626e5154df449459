"""--signing-key from end to end: a peer that signs with pymavlink's own signing, one that does not, and others."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest
from fake_autopilot import FakeAutopilot, free_port
from flight_process import flight_command
from patience import HANG_S

from companion.mavlink.dialect import mavlink
from replay.logs.tlog import read_tlog

KEY = bytes(range(32))


def sign_with(mav: Any, key: bytes) -> Any:
    """A pymavlink encoder or decoder that signs and demands signatures."""
    mav.signing.secret_key, mav.signing.sign_outgoing = key, True
    mav.signing.timestamp = int((time.time() - 1_420_070_400) * 1e5)
    return mav


class SigningAutopilot(FakeAutopilot):
    """Signs what it sends, and takes nothing that is not signed with its key."""

    def __init__(self, port: int, key: bytes = KEY):
        super().__init__(port)
        sign_with(self._mav, key)
        sign_with(self._parser, key)
        self.forged = 0

    def forge(self) -> None:
        """What somebody else would send to the same port: unsigned, disarmed, tilted."""
        ms = int(self.boot_s * 1000)
        for message in (
            mavlink.MAVLink_heartbeat_message(2, 3, 0, 5, 3, 3),
            mavlink.MAVLink_attitude_quaternion_message(ms, 0.8, 0.6, 0.0, 0.0, 0.0, 0.0, 0.0),
        ):
            self._socket.sendto(message.pack(mavlink.MAVLink(None, 1, 1)), self._target)
            self.forged += 1


def fly(
    autopilot: SigningAutopilot, key: Path, port: int, record: Path, forge: bool = False
) -> dict[str, Any]:
    command = flight_command(
        port, "--signing-key", str(key), "--json", "-", "--record", str(record), "--duration", "60"
    )
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    with autopilot, subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment
    ) as process:  # fmt: skip
        try:
            autopilot.wait_for("SET_ATTITUDE_TARGET", 30)
            for _ in range(20 if forge else 0):
                autopilot.forge()
                time.sleep(0.05)
            count = len(autopilot.of_type("SET_ATTITUDE_TARGET"))
            autopilot.wait_for("SET_ATTITUDE_TARGET", count + 20)
        finally:
            process.send_signal(signal.SIGINT)
            out, _ = process.communicate(timeout=HANG_S)
    return json.loads(out)


@pytest.fixture
def key(tmp_path: Path) -> Path:
    path = tmp_path / "key"
    path.write_bytes(KEY)
    return path


def test_a_peer_that_signs_is_flown_and_takes_what_is_signed(tmp_path: Path, key: Path):
    port, record = free_port(), tmp_path / "signed.tlog"
    autopilot = SigningAutopilot(port)
    report = fly(autopilot, key, port, record)
    assert report["messages"]["bad"] == 0
    assert report["commands"] > 30
    kinds = {m.get_type() for m in autopilot.received}
    assert {
        "HEARTBEAT",
        "COMMAND_LONG",
        "PARAM_REQUEST_READ",
        "NAMED_VALUE_FLOAT",
        "SET_ATTITUDE_TARGET",
    } <= kinds
    # The recording holds both directions, signatures included, and reads without a key.
    sent = [raw for _, raw in read_tlog(record).frames() if raw[6] == 191]
    assert len(sent) > 30
    assert all(raw[2] & 1 for raw in sent)


@pytest.mark.slow
def test_what_somebody_else_sends_unsigned_is_counted_and_changes_nothing(
    tmp_path: Path, key: Path
):
    port = free_port()
    autopilot = SigningAutopilot(port)
    report = fly(autopilot, key, port, tmp_path / "forged.tlog", forge=True)
    assert autopilot.forged == 40
    assert report["messages"]["bad"] == 40
    assert not {"not_armed", "tilted", "wrong_mode"} & set(report["refusals_s"])


@pytest.mark.slow
def test_an_unsigned_vehicle_is_not_flown_with_a_key(tmp_path: Path, key: Path):
    port = free_port()
    command = flight_command(port, "--signing-key", str(key), "--duration", "4", "--json", "-")
    with FakeAutopilot(port) as autopilot:
        ended = subprocess.run(command, capture_output=True, text=True, timeout=HANG_S, check=False)
    assert not autopilot.of_type("SET_ATTITUDE_TARGET")
    assert "signing key" in ended.stderr
    report = json.loads(ended.stdout)
    assert report["messages"]["received"] == 0
    assert report["messages"]["bad"] > 100


@pytest.mark.slow
def test_other_systems_are_ignored_and_counted(tmp_path: Path):
    port = free_port()
    command = flight_command(port, "--target-system", "1", "--duration", "4", "--json", "-")
    with FakeAutopilot(port), FakeAutopilot(port, system=7):
        ended = subprocess.run(command, capture_output=True, text=True, timeout=HANG_S, check=False)
    report = json.loads(ended.stdout)
    assert report["system"] == 1
    assert report["ignored_systems"] == [7]
    assert report["messages"]["ignored"] > 100
