"""The command that asks logs without a vehicle file: drafts and reasons beside what is known of the logs."""

from dataclasses import replace
from pathlib import Path

import pytest
from field import no_file
from field.no_file import Answer, Truth, answered_truly, drafted_truly, read_table

TABLE = Path(no_file.__file__).with_name("public_logs.toml")
FACTS = [{"key": "frame", "value": "quad-x"}, {"key": "rotors", "value": [9, 10, 11, 12]}]
ANSWERED = Answer(Path("a.BIN"), 0, 2.0, {"vehicle": {"known": FACTS}}, "")
REFUSED = Answer(Path("a.BIN"), 3, 2.0, {}, "replay: a.BIN: the vehicle did not fly")
QUAD = Truth(vehicle="quadcopter", frame="quad-x", rotors=(9, 10, 11, 12))
PLANE = Truth(vehicle="aeroplane", refused="plane")


def test_a_draft_is_right_as_far_as_the_truth_is_known():
    assert drafted_truly(ANSWERED, QUAD)
    assert drafted_truly(ANSWERED, replace(QUAD, frame="", rotors=()))
    assert not drafted_truly(ANSWERED, replace(QUAD, frame="quad-plus"))
    assert not drafted_truly(ANSWERED, replace(QUAD, rotors=(1, 2, 3, 4)))


@pytest.mark.parametrize(
    ("answer", "truth", "right"),
    [
        (ANSWERED, QUAD, True),
        (REFUSED, QUAD, False),
        (REFUSED, replace(QUAD, refused="did not fly"), True),
        (REFUSED, PLANE, False),
        (ANSWERED, PLANE, False),
        (replace(ANSWERED, code=2), QUAD, False),
    ],
)
def test_an_answer_is_right_for_its_reason(answer, truth, right):
    assert answered_truly(answer, truth) is right


def test_the_name_of_a_log_is_no_reason():
    log = Path("plane.BIN").resolve()
    answer = Answer(log, 3, 1.0, {}, f"replay: {log}: the vehicle did not fly")
    assert not answered_truly(answer, PLANE)


def test_the_table_of_public_logs_is_read():
    table = read_table(TABLE)
    assert len(table) >= 40
    assert len({truth.origin.split("@")[0] for truth in table.values()}) >= 20
    assert read_table(None) == {}


def test_a_wrong_draft_is_said_and_gives_exit_code_1(tmp_path, monkeypatch, capsys):
    table = tmp_path / "table.toml"
    table.write_text('["a.BIN"]\nvehicle = "hexacopter"\nframe = "hexa-x"\n')
    monkeypatch.setattr(no_file, "ask", lambda log: replace(ANSWERED, log=log))
    monkeypatch.setattr("sys.argv", ["no_file.py", str(tmp_path / "a.BIN"), "--table", str(table)])
    assert no_file.main() == 1
    assert "WRONG: drafted ('quad-x', [9, 10, 11, 12])" in capsys.readouterr().out
