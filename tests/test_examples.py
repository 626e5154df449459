"""Every example of the documents runs, as it says, and prints what it is for."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from log_writers import QUAD_MASS_KG, quad_flight, write_tlog

from companion.vehicles import QUAD
from models.corner_law import ClosedForm
from replay.cli import main

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "docs" / "examples"
HEAVIER_KG = 0.6


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two flights, a vehicle file, data of a fan, and a store."""
    folder = tmp_path_factory.mktemp("examples")
    for seed, name in enumerate(("monday", "friday")):
        flight = quad_flight(40.0, mass_kg=QUAD_MASS_KG + HEAVIER_KG, seed=seed)
        write_tlog(folder / f"{name}.tlog", flight)
    (folder / "my.toml").write_text(QUAD.read_text())
    data = ClosedForm().data_set()
    rows = ["h_m,d_m,rpm,Fx_N,Fy_N,Fz_N,Mx_Nm,My_Nm,Mz_Nm"]
    for h, d, rpm, wrench in zip(data.h, data.d, data.rpm, data.wrench, strict=True):
        rows.append(",".join(f"{v:.9g}" for v in (h, d, rpm, *wrench)))
    (folder / "fan.csv").write_text("\n".join(rows) + "\n")
    rows = ["t_s,qw,qx,qy,qz,ax,ay,az,p,q,r"]
    for k in range(100):
        rows.append(f"{0.02 * k:.2f},1,0,0,0,0,0,-9.81,0,0,0")
    (folder / "flight.mycsv").write_text("\n".join(rows) + "\n")
    logs = folder / "logs"
    logs.mkdir()
    os.link(folder / "monday.tlog", logs / "monday.tlog")
    command = ["diagnose", str(logs), "--vehicle", str(folder / "my.toml"), "--model", "none"]
    assert main([*command, "--out", str(folder / "fleet"), "--quiet"]) == 0
    return folder


RUNS = {
    "read_log.py": (["monday.tlog", "attitude.csv"], "attitudes written"),
    "diagnose_log.py": (["monday.tlog", "my.toml"], "payload"),
    "holds_on_another.py": (["monday.tlog", "friday.tlog", "my.toml"], "motion ahead"),
    "compare_flights.py": (["my.toml", "monday.tlog", "friday.tlog"], "friday.tlog: "),
    "motion_ahead.py": (["my.toml", "4000"], "after a second"),
    "own_surrogate.py": (["fan.csv", "fan", "polynomial"], "FanSurrogate(method='polynomial'"),
    "query_surrogate.py": ([], "of lift, trusted"),
    "own_effect.py": (["monday.tlog", "my.toml"], "s of flight judged"),
    "offsets_of_a_log.py": (["monday.tlog", "my.toml"], "decisions; the last: Decision("),
    "own_log_format.py": (["flight.mycsv"], "100 attitudes"),
    "upstream_controller.py": (["udpout:127.0.0.1:9", "0.5", "0.5"], "0 setpoints sent"),
    "fleet.py": (["fleet/store.sqlite"], "vehicles by effect"),
}


def test_every_example_is_run_and_listed() -> None:
    files = {path.name for path in EXAMPLES.glob("*.py")}
    assert files == set(RUNS)
    page = (EXAMPLES / "README.md").read_text()
    assert all(f"`{name}`" in page for name in files)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(RUNS))
def test_an_example_runs(place: Path, name: str) -> None:
    arguments, said = RUNS[name]
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / name), *arguments],
        cwd=place,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert said in done.stdout


@pytest.mark.parametrize("name", [name for name, (arguments, _) in RUNS.items() if arguments])
def test_without_arguments_it_says_how_it_is_called(name: str) -> None:
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / name)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert f"python docs/examples/{name} " in done.stderr


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        port: int = one.getsockname()[1]
    return port


@pytest.mark.slow
def test_a_controller_of_one_s_own_flies_the_built_in_vehicle_with_offsets(tmp_path: Path) -> None:
    port = free_port()
    report = tmp_path / "flight.json"
    place = ["--connect", "sim:corner", "--setpoint", f"udpin:127.0.0.1:{port}"]
    more = ["--duration", "15", "--quiet", "--json", str(report)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "companion", *place, *more]
    with subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL) as flight:
        example = str(EXAMPLES / "upstream_controller.py")
        done = subprocess.run(
            [sys.executable, example, f"udpout:127.0.0.1:{port}", "0.5", "20"],
            env=environment,
            capture_output=True,
            text=True,
        )
    assert flight.returncode == 0
    assert done.returncode == 0, done.stderr
    assert int(done.stdout.split()[0]) > 100
    told = json.loads(report.read_text())
    assert told["commands"] > 50
    assert told["compensated_s"] > 1.0
