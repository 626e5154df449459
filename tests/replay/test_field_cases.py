"""Logs of the field: each is written, read and answered; the command that judges the answers is judged, too."""

from dataclasses import replace

import pytest
from field import field_cases
from field.field_cases import Answer, ask, shared_cases, wrong
from field_case_logs import CASES, Expected

from replay import load

RIGHT = Answer(
    code=0,
    content={
        "duration_s": 20.0,
        "effects": [{"name": "rotor_drag"}],
        "vehicle": {
            "known": [{"key": "frame", "value": "quad-x"}, {"key": "rotors", "value": [1, 2, 3, 4]}]
        },
    },
    text="all is well",
    volts=(15.6, 16.4),
    speed_m_s=1.0,
)
REFUSED = replace(RIGHT, code=3, content={}, text="no RCOU in the log")
ASKED = Expected(text="", frame="quad-x", rotors=(1, 2, 3, 4), volts=(15.5, 16.5), speed_m_s=2.0)


@pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])
def test_every_case_is_read(case, tmp_path):
    path = tmp_path / f"log{case.suffix}"
    case.write(path)
    logs = load(path)
    assert logs
    assert case.expected.text
    assert case.expected.source


def test_a_right_answer_is_right():
    assert wrong(ASKED, RIGHT) == []


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"code": 1}, "exit code 1"),
        ({"volts": (5.0, 16.4)}, "battery (5.0, 16.4)"),
        ({"volts": None}, "battery None"),
        ({"speed_m_s": 5.0}, "5.0 m/s"),
        ({"text": "the vehicle did not fly"}, "says 'did not fly'"),
        ({"content": RIGHT.content | {"duration_s": 3.0}}, "3.0 s judged"),
        ({"content": RIGHT.content | {"effects": [{"name": "wind"}]}}, "names wind"),
        ({"content": RIGHT.content | {"vehicle": {"known": []}}}, "frame None, not quad-x"),
    ],
)
def test_a_wrong_answer_is_wrong_for_its_reason(changes, reason):
    assert reason in wrong(ASKED, replace(RIGHT, **changes))


def test_a_refusal_is_right_only_for_the_reason_that_was_expected():
    assert wrong(ASKED, REFUSED) == ["refused"]
    assert wrong(replace(ASKED, refused="RCOU"), REFUSED) == []
    assert wrong(replace(ASKED, refused="RFND"), REFUSED) == ["refused"]


def test_what_must_be_said_is_looked_for():
    assert wrong(replace(ASKED, says="well"), RIGHT) == []
    assert wrong(replace(ASKED, says="ESC 1"), RIGHT) == ["does not say 'ESC 1'"]


def test_every_given_case_has_an_expectation(shared_data):
    """No case of the folder is left out by the table."""
    folder = shared_data / "cases"
    if not folder.is_dir():
        pytest.skip(f"no cases in {folder}")
    assert {name for name, _, _ in shared_cases(folder)} == {path.name for path in folder.iterdir()}


def test_without_its_folder_the_command_says_so_and_goes_on(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(
        "sys.argv", ["field_cases.py", "--data", str(tmp_path / "none"), "--only", "no such case"]
    )
    assert field_cases.main() == 0
    assert "only the written ones" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])
def test_every_case_is_answered_as_expected(case, tmp_path):
    path = tmp_path / f"log{case.suffix}"
    case.write(path)
    assert wrong(case.expected, ask(path)) == []
