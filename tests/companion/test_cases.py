"""Some of the cases that crashed real firmwares, in lockstep: the table repeats itself and nothing is touched."""

from __future__ import annotations

import pytest
from flight_case import Case, fly_case
from safety import firmware_cases

from companion.vehicles import QUAD
from models.common.errors import LinkError
from models.vehicle import load_vehicle


def test_every_case_has_a_name_of_its_own_and_says_what_it_is():
    names = [case.name for case in firmware_cases.CASES]
    assert len(set(names)) == len(names) > 25
    assert all(case.what for case in firmware_cases.CASES)


@pytest.mark.slow
def test_a_case_repeats_itself():
    first, again = (firmware_cases.fly_one("ap_engage", 3, None, None).as_json() for _ in range(2))
    assert first == again
    assert first["engaged_s"] > 5.0
    assert first != firmware_cases.fly_one("ap_engage", 4, None, None).as_json()


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "px4_excursion_then_offboard",
        "px4_default_hover_thrust",
        "ap_kill_at_wall",
        "ap_body_offset",
    ],
)
def test_what_crashed_a_real_firmware_touches_nothing(name):
    outcome = firmware_cases.fly_one(name, 1, None, None)
    assert outcome.judgement.contact_s == 0.0
    assert outcome.judgement.height_loss_m < 0.3
    assert outcome.judgement.tilt_deg < 8.0


@pytest.mark.slow
def test_without_its_watchdog_a_kill_at_the_wall_ends_at_the_wall():
    """The manner of the real ArduCopter: level after GUID_TIMEOUT, then it drifts."""
    from companion.config import PipelineConfig
    from models.surrogate.empty import empty_model

    v = load_vehicle(QUAD)

    def script(p):
        p.world.last_word = False
        yield from firmware_cases.hold_then("kill", gap_m=0.15)(p)

    case = Case("kill", "", script, parameters={"GUID_TIMEOUT": 0.5}, wall_m=firmware_cases.WALL_M)
    assert fly_case(case, v, PipelineConfig(vehicle=v, model=empty_model(v))).judgement.wall_s > 1.0


def test_a_script_that_is_never_judged_is_an_error():
    from companion.config import PipelineConfig
    from models.surrogate.empty import empty_model

    v = load_vehicle(QUAD)

    def script(p):
        yield 0.5

    with pytest.raises(LinkError, match="before anything was judged"):
        fly_case(Case("none", "", script), v, PipelineConfig(vehicle=v, model=empty_model(v)))
