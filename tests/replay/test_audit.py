"""``replay audit`` on recordings: of flights, of other programs, and of nothing."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import pytest

from companion.mavlink.dialect import mavlink
from companion.mavlink.setpoints import AttitudeCommand, encode
from replay.cli import main


def record(path: Path, *, mode: int = 4, own: bool = True) -> Path:
    """One second of a vehicle at rest, and setpoints of component 191."""
    vehicle, companion = mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None, 1, 191)
    with path.open("wb") as file:

        def write(ms: int, raw: bytes) -> None:
            file.write(struct.pack(">Q", 1_700_000_000_000_000 + 1000 * ms) + raw)

        for ms in range(10_000, 11_000, 20):
            write(ms, mavlink.MAVLink_heartbeat_message(2, 3, 128, mode, 4, 3).pack(vehicle))
            attitude = mavlink.MAVLink_attitude_quaternion_message(
                ms, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            )
            write(ms, attitude.pack(vehicle))
            if own:
                _, payload = encode(AttitudeCommand(ms / 1000.0, (0.8, 0.6, 0.0, 0.0), 0.5), 1)
                message = mavlink.MAVLink_set_attitude_target_message(
                    ms, 1, 1, 7, [0.8, 0.6, 0.0, 0.0], 0, 0, 0, 0.5
                )
                assert message.pack(companion)[10:-2].rstrip(b"\0") == payload.rstrip(b"\0")
                write(ms, message.pack(companion))
    return path


def test_a_kept_flight_is_exit_code_0(tmp_path, capsys):
    log = record(tmp_path / "good.tlog")
    assert main(["audit", str(log)]) == 0
    assert "good.tlog: kept; 50 sent, 50 setpoints" in capsys.readouterr().out


def test_a_broken_promise_is_exit_code_1_and_said_with_its_time(tmp_path, capsys):
    good, bad = record(tmp_path / "good.tlog"), record(tmp_path / "bad.tlog", mode=5)
    assert main(["audit", str(good), str(bad), "--json", "-"]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert [one["kept"] for one in answer["logs"]] == [True, False]
    mode = answer["logs"][1]["promises"]["mode"]
    assert (mode["checked"], mode["broken"]) == (50, 50)
    assert mode["first_s"] == 0.0
    assert "mode 0x5" in mode["first"]
    assert main(["audit", str(bad)]) == 1
    assert "NOT KEPT" in capsys.readouterr().out


def test_a_dry_run_may_hold_no_setpoint(tmp_path):
    assert main(["audit", str(record(tmp_path / "f.tlog")), "--dry-run", "--quiet"]) == 1


@pytest.mark.parametrize("name", ["quiet.tlog", "other.bin", "none.tlog", "empty.tlog"])
def test_what_cannot_be_audited_is_one_line_and_exit_code_3(name, tmp_path, capsys):
    log = tmp_path / name
    if name == "quiet.tlog":
        record(log, own=False)
    elif name != "none.tlog":
        log.write_bytes(b"" if name == "empty.tlog" else b"\xa3\x95")
    assert main(["audit", str(log)]) == 3
    err = capsys.readouterr().err
    assert name in err
    assert err.count("\n") == 1


@pytest.mark.slow
def test_recordings_on_real_firmwares(shared_data, capsys):
    """Of an older version of this program: what it did wrong on PX4 is found, and nothing on ArduPilot."""
    folder = shared_data / "firmware"
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    ardupilot = sorted((folder / "ardupilot").glob("*.tlog"))
    options = ["--vehicle", str(folder / "ardupilot" / "quad3.toml"), "--quiet"]
    assert main(["audit", *map(str, ardupilot), *options]) == 0
    crash = folder / "px4" / "crash_hold_engaged_before_offboard.tlog"
    assert main(["audit", str(crash), "--json", "-"]) == 1
    answer = json.loads(capsys.readouterr().out)
    broken = {name for name, kept in answer["logs"][0]["promises"].items() if kept["broken"]}
    assert broken == {"mode"}
