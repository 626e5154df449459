from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from companion.cli import main as companion
from companion.mavlink.dialect import mavlink
from companion.mavlink.wire_frames import cut
from companion.sim import compare
from companion.sim.air import LawError
from companion.sim.body import DT
from companion.sim.compare import CompareSettings, fly
from companion.sim.compare_plot import write_plot
from companion.sim.compare_report import LegComparison, air_part, as_json, as_text
from companion.sim.flight import SimulatedFlight
from companion.sim.flown import AXES, PHASES, STEP_S, Flown, Leg, Witness, flown
from companion.sim.scenario import Waypoint, build
from companion.vehicles import default_vehicle
from models.common.errors import ConfigError, LinkError
from replay.logs.tlog import read_tlog

ROOT = Path(__file__).resolve().parents[2]
TIME = np.arange(0.0, 50.0, STEP_S)
TRAJECTORY = np.sin(0.3 * TIME)
AIR = np.cos(0.7 * TIME)
PHASE = np.minimum((TIME / 10.0).astype(int), 3)
"""Ten seconds low, at the wall and in the corner, then between."""


def leg(
    which: Leg, seed: int, air: float, touched: float = 0.0, approach_s: float = math.inf
) -> Flown:
    """A flight whose error is the trajectory's own (1 cm, 1 deg) plus ``air`` times what the air adds."""
    error = 0.01 * TRAJECTORY + 0.02 * air * AIR
    both = np.column_stack([error, np.zeros_like(error)])
    return Flown(
        leg=which,
        seed=seed,
        time_s=TIME,
        height=error,
        lateral=both,
        tilt=np.radians(100.0) * both,
        touched_s=touched,
        phase=PHASE,
        approach_s=approach_s,
    )


def flights(seed: int = 1, left: float = 0.4) -> list[Flown]:
    return [
        leg(Leg.AUTOPILOT, seed, 3.0, touched=1.5),
        leg(Leg.OFF, seed, 1.0),
        leg(Leg.ON, seed, left),
        leg(Leg.FREE, seed, 0.0),
    ]


def compared(*flown_legs: Flown) -> LegComparison:
    return LegComparison("corner", "shipped", (LawError(0.2, 0.21, 0.15),), flown_legs)


def test_a_remaining_share_of_the_air_is_found_again():
    part = air_part(flights(left=0.4) + flights(2, left=0.4))
    assert part is not None
    for axis in AXES:
        assert part["paired"][axis] == pytest.approx(1.0 - 0.4**2, abs=1e-9)
        assert part["energy"][axis] == pytest.approx(1.0 - 0.4**2, abs=0.05)


def test_offsets_that_do_nothing_remove_nothing_and_harm_is_negative():
    nothing, harm = air_part(flights(left=1.0)), air_part(flights(left=1.5))
    assert nothing is not None
    assert harm is not None
    assert nothing["paired"]["height"] == pytest.approx(0.0)
    assert harm["paired"]["height"] < -1.0


def test_without_a_free_flight_there_is_no_air_part():
    assert air_part(flights()[:3]) is None


def test_air_that_adds_nothing_has_no_share():
    still = [leg(Leg.OFF, 1, 0.0), leg(Leg.ON, 1, 0.0), leg(Leg.FREE, 1, 0.0)]
    part = air_part(still)
    assert part is not None
    assert math.isnan(part["energy"]["height"])
    assert math.isnan(part["paired"]["height"])
    text = as_text(compared(*still))
    assert "height: no share: with and without the air it is" in text
    assert "%" not in text.partition("by energy")[2]


def test_a_share_of_what_flights_do_not_tell_apart_is_not_printed():
    """The air adds a hundredth to what the path costs: a share of that would be a number without a meaning."""
    free = leg(Leg.FREE, 1, 0.0)
    off = replace(free, leg=Leg.OFF, tilt=1.01 * free.tilt, lateral=2.0 * free.lateral)
    on = replace(free, leg=Leg.ON, tilt=1.03 * free.tilt)
    text = as_text(compared(off, on, free))
    assert "tilt: no share" in text
    assert "lateral 100 %" in text
    assert "tilt -" not in text


def test_table_shows_every_leg_with_its_numbers():
    text = as_text(compared(*flights()))
    rows = {line[:28].strip(): line[28:].split() for line in text.splitlines()[:9]}
    off = flights()[1]
    assert float(rows[Leg.OFF.value][0]) == pytest.approx(off.rms("height"), abs=0.06)
    assert float(rows[Leg.OFF.value][3]) == pytest.approx(off.peak("lateral"), abs=0.06)
    assert "1.5 s" in text
    assert "simulated" in text
    assert (
        "model: shipped, wrong about this air by 20 % in lift, 21 % in pull, 15 % in tilt; no offsets: 100 %"
        in text
    )
    assert "one flight does not tell rows apart" in text


def test_table_of_several_seeds_gives_mean_and_sd():
    text = as_text(compared(*flights(1), *flights(2)))
    assert "2 seeds, mean ± sd" in text
    assert "one flight does not tell rows apart" not in text
    assert "± 0" in text


def test_json_has_means_shares_and_every_flight():
    report = json.loads(json.dumps(as_json(compared(*flights(1), *flights(2)))))
    assert report["seeds"] == [1, 2]
    assert set(report["legs"]) == {"autopilot", "off", "on", "free"}
    assert report["legs"]["on"]["height"]["rms"]["sd"] == pytest.approx(0.0)
    assert report["air_caused_part_removed"]["on"]["paired"]["tilt"] == pytest.approx(
        0.84, abs=1e-3
    )
    assert report["model_error"] == {
        "lift": 0.2,
        "pull": 0.21,
        "tilt": 0.15,
        "without_offsets": 1.0,
    }
    assert len(report["flights"]) == 8


def test_text_and_json_say_the_error_phase_by_phase():
    off = flights()[1]
    (found,) = as_json(compared(*flights()))["legs"]["off"]["approaches"]
    assert list(found) == ["all", *PHASES]
    row = next(
        line
        for line in as_text(compared(*flights())).splitlines()[9:]
        if line.startswith(Leg.OFF.value)
    )
    cells = [float(v) for v in row[28:].replace("/", " ").split()]
    for k, phase in enumerate(found):
        for axis, cell in zip(("height", "lateral"), cells[2 * k : 2 * k + 2], strict=True):
            expected = off.rms(axis, off.during(phase=None if phase == "all" else phase))
            assert found[phase][axis] == pytest.approx(expected, abs=1e-3)
            assert cell == pytest.approx(expected, abs=0.06)


def test_approaches_are_told_one_by_one():
    several = [leg(Leg.OFF, 1, 1.0, approach_s=25.0), leg(Leg.ADAPTED, 1, 0.4, approach_s=25.0)]
    first, second = as_json(compared(*several))["legs"]["adapted"]["approaches"]
    half = len(TIME) // 2
    assert first["all"]["height"] == pytest.approx(
        np.sqrt(np.mean(several[1].size("height")[:half] ** 2)), abs=1e-3
    )
    assert second["all"]["height"] == pytest.approx(
        np.sqrt(np.mean(several[1].size("height")[half:] ** 2)), abs=1e-3
    )
    text = as_text(compared(*several))
    assert "2 approaches" in text
    assert text.count("approach 2") == 2


def test_the_picture_shows_lines_and_phases(tmp_path: Path):
    write_plot(tmp_path / "errors.svg", compared(*flights()))
    root = ElementTree.fromstring((tmp_path / "errors.svg").read_text())
    texts = [e.text for e in root.iter() if e.tag.endswith("text")]
    assert {Leg.AUTOPILOT.value, Leg.OFF.value, Leg.ON.value, "low", "wall", "corner"} <= set(texts)
    assert "height error [mm]" in texts
    assert len([e for e in root.iter() if e.tag.endswith("polyline")]) == 6
    with pytest.raises(ConfigError, match="--plot"):
        write_plot(tmp_path / "none" / "errors.svg", compared(*flights()))


def truth(**changes: np.ndarray) -> dict[str, np.ndarray]:
    zero = np.zeros_like(TIME)
    names = (
        "n",
        "e",
        "d",
        "ref_n",
        "ref_e",
        "ref_d",
        "roll",
        "pitch",
        "need_roll",
        "need_pitch",
        "contact",
        "phase",
    )
    return {
        "script_s": TIME,
        "streamed": np.ones_like(TIME),
        **{name: zero for name in names},
        **changes,
    }


def test_errors_are_the_truth_minus_the_reference_without_the_start_offset():
    result = flown(
        Leg.ON,
        1,
        truth(d=np.full_like(TIME, -1.17) + 0.05 * (TIME > 20.0), ref_d=np.full_like(TIME, -1.2)),
    )
    assert result.peak("height") == pytest.approx(50.0)
    assert result.height[-1] == pytest.approx(-0.05)  # above the ground is positive
    assert result.rms("lateral") == 0.0


def test_tilt_error_is_against_the_tilt_that_the_air_needs():
    result = flown(
        Leg.ON, 1, truth(roll=np.full_like(TIME, 0.02), need_roll=np.full_like(TIME, -0.01))
    )
    assert result.rms("tilt") == pytest.approx(math.degrees(0.03))


def test_a_flight_whose_script_did_not_run_is_an_error():
    with pytest.raises(LinkError, match="did not run"):
        flown(Leg.ON, 1, {k: v[:5] for k, v in truth().items()})


def test_a_flight_that_the_companion_did_not_fly_is_an_error():
    with pytest.raises(LinkError, match="flew only 0 %"):
        flown(Leg.OFF, 1, truth(streamed=np.zeros_like(TIME)))


def test_the_reference_in_the_truth_is_a_line_and_no_steps():
    """The pilot speaks at 20 Hz, the truth is taken down at 50 Hz: between two targets the reference moves on."""
    flight = SimulatedFlight(default_vehicle(), build("corner", default_vehicle()), 1)
    witness = Witness(flight)
    witness.step()  # the script has not begun
    flight.script_began_s = 0.0
    while flight.time_s < flight.scenario.duration_s:
        flight.body.time_s += DT
        witness.step()
    columns = witness.columns()
    assert np.diff(columns["script_s"]) == pytest.approx(STEP_S)
    for axis, name in enumerate("ned"):
        speed = np.array([flight.scenario.reference(t).velocity[axis] for t in columns["script_s"]])
        assert np.diff(columns[f"ref_{name}"]) == pytest.approx(
            0.5 * STEP_S * (speed[1:] + speed[:-1]), abs=5e-5
        )
    assert set(columns["phase"]) == {0.0, 1.0, 2.0, 3.0}
    assert not columns["streamed"].any()


def test_jobs_keep_their_order(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(compare, "fly", lambda settings, which, seed: leg(which, seed, 0.0))
    result = compare.run_compare(
        [1, 2], compare.CompareSettings(), legs=(Leg.OFF, Leg.ON), workers=1
    )
    assert [(f.seed, f.leg) for f in result] == [
        (1, Leg.OFF),
        (1, Leg.ON),
        (2, Leg.OFF),
        (2, Leg.ON),
    ]


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Six seconds of hover in place of every scenario, flown one after another."""
    waypoints = (Waypoint(0.0, 0.0, 1.2, name="free"), Waypoint(6.0, 0.0, 1.2, name="end"))
    monkeypatch.setattr(
        compare,
        "build",
        lambda name, vehicle, air=True, turned_rad=0.0: replace(
            build("hover", vehicle, air=air, turned_rad=turned_rad), waypoints=waypoints
        ),
    )
    monkeypatch.setattr(compare.os, "cpu_count", lambda: 1)


@pytest.mark.slow
@pytest.mark.usefixtures("short")
def test_adaptation_flies_and_three_approaches_of_it(capsys: pytest.CaptureFixture[str]):
    assert companion(["--connect", "sim:hover", "--compare", "--adapt", "full", "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found["legs"]) == {"autopilot", "off", "on", "adapted", "free"}
    assert all(len(one["approaches"]) == 3 for one in found["legs"].values())
    adapted = {one["leg"]: one.get("adapted", {}) for one in found["flights"]}
    assert adapted["adapted"]["thrust_scale"]["sd"] < 0.06
    assert not any(adapted[name] for name in ("off", "on", "free"))


@pytest.mark.slow
@pytest.mark.usefixtures("short")
def test_the_leg_without_offsets_is_recorded_and_the_picture_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    log, picture = tmp_path / "off.tlog", tmp_path / "errors.svg"
    arguments = [
        "--connect",
        "sim:hover",
        "--compare",
        "--record",
        str(log),
        "--plot",
        str(picture),
        "--model",
        "none",
    ]
    assert companion(arguments) == 0
    assert "model: none, wrong about this air by 100 % in lift" in capsys.readouterr().out
    assert picture.exists()
    assert [p.name for p in tmp_path.glob("*.tlog")] == ["off.tlog"]
    sent = [cut(raw, 0).id for _, raw in read_tlog(log).frames()]
    assert sent.count(mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET) > 200


@pytest.mark.slow
def test_the_readme_says_what_the_demonstration_flies():
    """None of its flights may lose control: the sentence is in millimetres, a vehicle that tumbles in metres."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (sentence,) = [line for line in readme.splitlines() if line.startswith("Autopilot alone, our")]
    legs = [fly(CompareSettings(), leg, seed=0) for leg in (Leg.AUTOPILOT, Leg.OFF, Leg.ON)]
    lateral_mm = ", ".join(f"{one.rms('lateral'):.0f}" for one in legs)
    touched = ", ".join(f"{one.touched_s:.1f} s" if one.touched_s else "never" for one in legs)
    assert f"lateral error {lateral_mm} mm; wall touched {touched} (seed 0)" in sentence
    assert max(one.peak("tilt") for one in legs) < 15.0
