from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from companion.sim import compare
from companion.sim.compare import AXES, Flown, Leg, Settings, air_part, as_json, as_text, flown, read_truth
from models.errors import ConfigError, LinkError

TIME = np.arange(0.0, 50.0, compare.STEP_S)
TRAJECTORY = np.sin(0.3 * TIME)
AIR = np.cos(0.7 * TIME)
WRONG = {"lift": 0.2, "pull": 0.2, "tilt": 0.15}


def leg(which: Leg, seed: int, air: float, touched: float = 0.0) -> Flown:
    """A flight whose error is the trajectory's own (1 cm, 1 deg) plus ``air`` times what the air adds."""
    error = 0.01 * TRAJECTORY + 0.02 * air * AIR
    both = np.column_stack([error, np.zeros_like(error)])
    return Flown(which, seed, TIME, error, both, np.radians(100.0) * both, touched, WRONG)


def flights(seed: int = 1, left: float = 0.4) -> list[Flown]:
    return [
        leg(Leg.AUTOPILOT, seed, 3.0, touched=1.5),
        leg(Leg.OFF, seed, 1.0),
        leg(Leg.ON, seed, left),
        leg(Leg.FREE, seed, 0.0),
    ]


def test_a_remaining_share_of_the_air_is_found_again():
    part = air_part(flights(left=0.4) + flights(2, left=0.4))
    assert part is not None
    for axis in AXES:
        assert part.paired[axis] == pytest.approx(1.0 - 0.4**2, abs=1e-9)
        assert part.energy[axis] == pytest.approx(1.0 - 0.4**2, abs=0.05)


def test_offsets_that_do_nothing_remove_nothing_and_harm_is_negative():
    nothing, harm = air_part(flights(left=1.0)), air_part(flights(left=1.5))
    assert nothing is not None
    assert harm is not None
    assert nothing.paired["height"] == pytest.approx(0.0)
    assert harm.paired["height"] < -1.0


def test_without_a_free_flight_there_is_no_air_part():
    assert air_part(flights()[:3]) is None


def test_air_that_adds_nothing_has_no_share():
    still = [leg(Leg.OFF, 1, 0.0), leg(Leg.ON, 1, 0.0), leg(Leg.FREE, 1, 0.0)]
    part = air_part(still)
    assert part is not None
    assert math.isnan(part.energy["height"])
    assert math.isnan(part.paired["height"])
    assert "-" in as_text(still, Settings()).splitlines()[-1]


def test_table_shows_every_leg_with_its_numbers():
    text = as_text(flights(), Settings())
    rows = {line[:24].strip(): line[24:].split() for line in text.splitlines()}
    off = flights()[1]
    assert float(rows[Leg.OFF.value][0]) == pytest.approx(off.rms("height"), abs=0.06)
    assert float(rows[Leg.OFF.value][3]) == pytest.approx(off.peak("lateral"), abs=0.06)
    assert "1.5 s" in text
    assert "simulated" in text
    assert "20 % in lift" in text


def test_table_of_several_seeds_gives_mean_and_sd():
    text = as_text(flights(1) + flights(2), Settings())
    assert "2 seeds, mean ± sd" in text
    assert "± 0" in text


def test_json_has_means_shares_and_every_flight():
    report = json.loads(json.dumps(as_json(flights(1) + flights(2), Settings())))
    assert report["seeds"] == [1, 2]
    assert set(report["legs"]) == {"autopilot", "off", "on", "free"}
    assert report["legs"]["on"]["height"]["rms"]["sd"] == pytest.approx(0.0)
    assert report["air_caused_part_removed"]["paired"]["tilt"] == pytest.approx(0.84, abs=1e-3)
    assert len(report["flights"]) == 8


def truth(**changes: np.ndarray) -> dict[str, np.ndarray]:
    zero = np.zeros_like(TIME)
    names = ("n", "e", "d", "ref_n", "ref_e", "ref_d", "roll", "pitch", "need_roll", "need_pitch", "contact")
    return {"script_s": TIME, "streamed": np.ones_like(TIME), **{name: zero for name in names}, **changes}


def test_errors_are_the_truth_minus_the_reference_without_the_start_offset():
    result = flown(
        Leg.ON, 1, truth(d=np.full_like(TIME, -1.17) + 0.05 * (TIME > 20.0), ref_d=np.full_like(TIME, -1.2)), WRONG
    )
    assert result.peak("height") == pytest.approx(50.0)
    assert result.height[-1] == pytest.approx(-0.05)  # above the ground is positive
    assert result.rms("lateral") == 0.0


def test_tilt_error_is_against_the_tilt_that_the_air_needs():
    result = flown(Leg.ON, 1, truth(roll=np.full_like(TIME, 0.02), need_roll=np.full_like(TIME, -0.01)), WRONG)
    assert result.rms("tilt") == pytest.approx(math.degrees(0.03))


def test_a_flight_whose_script_did_not_run_is_an_error():
    with pytest.raises(LinkError, match="did not run"):
        flown(Leg.ON, 1, {k: v[:5] for k, v in truth().items()}, WRONG)


def test_a_flight_that_the_companion_did_not_fly_is_an_error():
    with pytest.raises(LinkError, match="flew only 0 %"):
        flown(Leg.OFF, 1, truth(streamed=np.zeros_like(TIME)), WRONG)


def test_truth_is_read_from_where_the_script_begins(tmp_path: Path):
    path = tmp_path / "truth.csv"
    path.write_text(
        "time_s,script_s,phase,hand,d\n1,-1,free,none,-1\n2,0,free,stream,-1.2\n3,1,free,stream,-1.3\n4,2,f\n"
    )
    columns = read_truth(path)
    assert columns["d"].tolist() == [-1.2, -1.3]
    assert columns["streamed"].tolist() == [1.0, 1.0]
    assert "phase" not in columns


def test_unknown_scenario_is_refused_by_name():
    with pytest.raises(ConfigError, match="sim:moon"):
        compare.main("moon")


def test_jobs_keep_their_order(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(compare, "fly", lambda settings, which, seed: leg(which, seed, 0.0))
    result = compare.run_compare([1, 2], legs=(Leg.OFF, Leg.ON), workers=1)
    assert [(f.seed, f.leg) for f in result] == [(1, Leg.OFF), (1, Leg.ON), (2, Leg.OFF), (2, Leg.ON)]
