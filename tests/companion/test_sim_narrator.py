"""The built-in vehicle tells its phases and its end."""

import io
import json
import math

from companion.cli import main, scenario_name
from companion.sim.flight import Flight
from companion.sim.narrator import Narrator, follow
from companion.sim.scenario import build
from companion.vehicles import default_vehicle


def test_every_phase_once_and_one_end(capsys):
    vehicle = default_vehicle()
    flight = Flight(vehicle, build("corner", vehicle), 0)
    narrator = Narrator(flight)
    narrator.step()  # the script has not begun
    assert capsys.readouterr().out == ""
    duration = flight.scenario.duration_s
    for k in range(math.ceil(duration * 10) + 20):
        flight.script_began_s = -0.1 * (k + 1)
        narrator.step()
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    ground = ["free", "descend", "ground", "climb", "free"]
    corner = ["approach", "wall", "descend at wall", "corner", "climb at wall", "wall", "retreat", "free"]
    assert [line["phase"] for line in lines[:-1]] == [*ground, *corner]
    assert lines[-1] == {"over_s": round(duration, 1)}


def test_the_flight_program_says_them_and_stops():
    said, ended = [], []
    stream = io.StringIO('{"phase": "descend", "left_s": 22}\n{"over_s": 40.0}\n')
    follow(stream, said.append, lambda: ended.append(True)).join(5.0)
    assert said[0] == "sim: descend (22 s to go)"
    assert "over" in said[1]
    assert ended == [True]


def test_sim_alone_is_the_corner(capsys):
    assert scenario_name("sim:") == "corner"
    assert scenario_name("sim:hover") == "hover"
    assert main(["--connect", "sim:nowhere"]) == 2
    assert "corner" in capsys.readouterr().err
