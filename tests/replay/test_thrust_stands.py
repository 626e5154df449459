"""Thrust stands of others: the rows that are read, and laws that tell a run that they have not seen."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest
from tables import crazyflie_stand, stand, thrust_map

from models.common.frames import Array

TRUE = (60.0, 0.7, 1.4)


def runs() -> dict[str, Array]:
    """Two batteries on a stand, by the law itself."""
    rng = np.random.default_rng(3)
    out = {}
    for name, full in (("a", 4.1), ("b", 3.8)):
        pwm = rng.uniform(2e4, 6e4, 40)
        volts = rng.uniform(full - 0.5, full, 40)
        thrust = stand.thrust(
            pwm / crazyflie_stand.FULL_COMMAND, volts, *TRUE, crazyflie_stand.FULL_V
        )
        speeds = np.repeat(np.sqrt(thrust)[:, None], 4, axis=1)
        out[name] = np.column_stack([pwm, volts, speeds, thrust])
    return out


def test_a_law_tells_the_other_battery_where_it_is_true():
    errors = {
        name: stand.left_out(runs(), teller, crazyflie_stand.THRUST)
        for name, teller in crazyflie_stand.TELLERS.items()
    }
    assert np.abs(errors["throttle and battery_sag"]["b"]).max() < 1e-4
    assert np.abs(errors["rotor speeds squared"]["a"]).max() < 1e-6
    assert np.abs(errors["polynomial of degree 2"]["b"]).max() > 0.01


def test_the_command_is_the_one_that_gives_the_thrust():
    command = np.linspace(0.35, 0.45, 5)
    volts = np.full(5, 23.0)
    thrust = stand.thrust(command, volts, 12.0, 0.6, 1.2, thrust_map.FULL_V)
    rows = np.column_stack([1000.0 + 1000.0 * command, thrust, volts])
    assert thrust_map.command(rows, 12.0, 0.6, 1.2) == pytest.approx(rows[:, 0])


def test_rows_out_of_the_authors_limits_are_left_out():
    rows = np.array([[1400.0, -3.0, 22.0], [1600.0, -3.0, 22.0], [1400.0, 0.1, 22.0]])
    assert thrust_map.kept(rows).tolist() == [[1400.0, 3.0, 22.0]]


def test_rows_without_a_number_are_left_out(tmp_path, monkeypatch):
    text = "\ufeffa,b\n1,2\n3,\n"
    monkeypatch.setattr(stand, "read", lambda *_: text.encode())
    assert stand.rows_of(tmp_path, "0", "f.csv", ("b", "a")).tolist() == [[2.0, 1.0]]


@pytest.mark.parametrize("command", [crazyflie_stand, thrust_map])
def test_a_stand_is_skipped_without_its_clone(command: ModuleType, tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["table", str(tmp_path / "nowhere")])
    with pytest.raises(SystemExit, match=r"skipped: .*no clone"):
        command.main()


def test_other_rows_than_the_known_ones_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["table", str(tmp_path)])
    monkeypatch.setattr(crazyflie_stand, "rows_of", lambda *_: np.zeros((2, 7)))
    with pytest.raises(SystemExit, match="refused: 6 rows are there, known 353"):
        crazyflie_stand.main()
