"""``replay vehicle``: known truth comes back out of logs of a hover."""

import json
from dataclasses import replace

import pytest
from log_writers import EPOCH_US, QUAD_CT, QUAD_MASS_KG, flight, quad_flight, write_tlog

from companion.vehicles import QUAD
from models.frames import GRAVITY
from models.vehicle import Rotor, Throttle, load_vehicle
from models.vehicle_setup.toml_text import vehicle_text
from replay.cli import main
from replay.logs import tlog_blocks


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "hover.tlog"
    write_tlog(path, quad_flight(80.0))
    return path


def written(path, vehicle):
    path.write_text(vehicle_text(vehicle))
    return path


def numbers(capsys, *arguments):
    assert main(["vehicle", *map(str, arguments), "--json", "-"]) == 0
    return json.loads(capsys.readouterr().out)


def test_ct_comes_back_from_a_wrong_file_and_from_one_without(log, tmp_path, capsys):
    shipped = load_vehicle(QUAD)
    for ct in (0.010, 0.019, None):
        start = written(tmp_path / "v.toml", replace(shipped, fans=tuple(replace(f, ct=ct) for f in shipped.fans)))
        told = numbers(capsys, log, "--vehicle", start, "--out", tmp_path / "new.toml")
        assert told["hover_s"] > 8.0
        assert told["vehicle"]["ct"]["before"] == ct
        assert told["vehicle"]["ct"]["value"] == pytest.approx(QUAD_CT, rel=0.01)
        low, high = told["vehicle"]["ct"]["ci95"]
        assert low < told["vehicle"]["ct"]["value"] < high
        made = load_vehicle(tmp_path / "new.toml")
        assert all(f.ct == pytest.approx(QUAD_CT, rel=0.01) for f in made.fans)
        assert made.fans[0].position_m == shipped.fans[0].position_m
    assert "measured in hover.tlog" in (tmp_path / "new.toml").read_text()


def test_a_stretch_on_the_bench_does_not_cost_the_rest_of_a_long_log(tmp_path, capsys, monkeypatch):
    parked = quad_flight(60.0, parked=True)
    later = 60_000_000 + EPOCH_US
    write_tlog(tmp_path / "long.tlog", [*parked, *quad_flight(80.0, start_ms=100_000, arrival_us=later)])
    monkeypatch.setattr(tlog_blocks, "BLOCK_BYTES", 256 * 1024)
    told = numbers(capsys, tmp_path / "long.tlog", "--vehicle", QUAD)
    assert told["vehicle"]["ct"]["value"] == pytest.approx(QUAD_CT, rel=0.01)
    assert any(note.startswith("left out: ") for note in told["notes"])


def test_throttle_curve_comes_back(log, tmp_path, capsys):
    # The writer's outputs are linear: 1100 us nothing, 1900 us twice the weight on four rotors.
    shipped = load_vehicle(QUAD)
    fans = tuple(
        replace(f, ct=None, cq=None, rotors=(Rotor(f.rotors[0].spin, servo=k),)) for k, f in enumerate(shipped.fans, 1)
    )
    curve = Throttle(10.0, 0.3, 1100.0, 1900.0, 14.0)
    start = written(tmp_path / "v.toml", replace(shipped, fans=fans, throttle=curve, hover_thrust=0.5))
    told = numbers(capsys, log, "--vehicle", start, "--out", tmp_path / "new.toml")["vehicle"]
    top = QUAD_MASS_KG * GRAVITY / 2.0
    made = load_vehicle(tmp_path / "new.toml").throttle
    assert made.expo == pytest.approx(0.0, abs=0.15) if "expo" in told else made.expo == 0.3
    u = 0.5
    lift = 4 * made.max_thrust_n * ((1 - made.expo) * u + made.expo * u * u)
    assert lift == pytest.approx(QUAD_MASS_KG * GRAVITY, rel=0.02)
    if "expo" in told:
        assert made.max_thrust_n == pytest.approx(top, rel=0.1)


def test_too_little_hover_is_said(tmp_path, capsys):
    path = tmp_path / "low.tlog"
    write_tlog(path, flight(20.0))  # half a metre over the ground: in its air
    assert main(["vehicle", str(path), "--vehicle", str(QUAD)]) == 3
    err = capsys.readouterr().err
    assert len(err.strip().splitlines()) == 1
    assert main(["vehicle", str(tmp_path / "none.tlog"), "--vehicle", str(QUAD)]) == 3


def test_real_firmware_with_simulated_physics(shared_data, tmp_path, capsys):
    """The true C_T and the true hover throttle of that simulator are known: 0.01376 and 0.438."""
    (log,) = (shared_data / "ardupilot").glob("s1*.tlog")
    vehicle = load_vehicle(log.with_suffix(".toml"))
    start = written(tmp_path / "v.toml", replace(vehicle, fans=tuple(replace(f, ct=0.011) for f in vehicle.fans)))
    told = numbers(capsys, log, "--vehicle", start)["vehicle"]
    assert told["ct"]["value"] == pytest.approx(0.01376, rel=0.01)
    assert told["hover_thrust"]["value"] == pytest.approx(0.438, abs=0.01)
