"""Which vehicle flies: a file, one that ships by its name, and without either nothing is sent to a real link."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from fake_autopilot import FakeAutopilot, free_port

from companion.cli import main
from companion.vehicles import QUAD, TANDEM, chosen_vehicle, vehicle_path


def test_a_name_is_a_file_that_ships_unless_there_is_a_file_of_that_name(tmp_path, monkeypatch):
    assert vehicle_path("tandem") == TANDEM
    assert vehicle_path("quad") == QUAD
    assert vehicle_path("mine.toml") == Path("mine.toml")
    monkeypatch.chdir(tmp_path)
    Path("quad").write_text(TANDEM.read_text())
    assert chosen_vehicle(vehicle_path("quad")).name == chosen_vehicle(None).name


@pytest.mark.slow
@pytest.mark.parametrize(("options", "dry"), [([], True), (["--vehicle", "tandem"], False)])
def test_without_a_vehicle_nothing_is_sent_to_a_real_link(options, dry, capsys):
    port = free_port()
    with FakeAutopilot(port):
        arguments = [
            "--connect",
            f"udpin:127.0.0.1:{port}",
            "--duration",
            "2",
            "--json",
            "-",
            *options,
        ]
        assert main(arguments) == 0
    told = capsys.readouterr()
    assert json.loads(told.out)["dry_run"] is dry
    assert ("no --vehicle: nothing is sent" in told.err) is dry
