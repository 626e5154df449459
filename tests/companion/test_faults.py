"""The fault campaign as tests: a few faults every time, one of each kind with the slow tests, all: ``-m faults``."""

from __future__ import annotations

import pytest
from faults.campaign import complaints, fly
from faults.catalog import BY_NAME, FAULTS

ALWAYS = (("link_lost_10s", "ardupilot"), ("killed_restarted", "px4"))
"""The link, the program itself."""
OFTEN = (
    ("rotors_absurd", "ardupilot"),
    ("range_down_silent", "px4"),
    ("range_wall_frozen", "ardupilot"),
    ("rotors_frozen", "ardupilot"),
    ("link_lost_3s", "px4"),
    ("position_silent", "px4"),
    ("replayed_packets", "ardupilot"),
    ("height_drifts", "ardupilot"),
    ("says_landed", "ardupilot"),
    ("starved_0.8s", "ardupilot"),
    ("wind_gust", "px4"),
)
"""With those above, one of each kind: those that once went wrong."""
MISSED = ("vision_turned",)
STACKS = ("ardupilot", "px4")


def check(name: str, stack: str) -> None:
    result = fly(BY_NAME[name], stack)
    assert result.outputs > 500
    assert complaints(BY_NAME[name], result) == []


@pytest.mark.parametrize(("name", "stack"), ALWAYS)
def test_a_few_faults_every_time(name, stack):
    check(name, stack)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "stack"), OFTEN)
def test_one_fault_of_each_kind(name, stack):
    check(name, stack)


@pytest.mark.faults
@pytest.mark.parametrize("stack", STACKS)
@pytest.mark.parametrize("name", [f.name for f in FAULTS])
def test_every_fault_with_both_manners(name, stack):
    if stack not in BY_NAME[name].stacks:
        pytest.skip(f"only with {', '.join(BY_NAME[name].stacks)}")
    if name in MISSED:
        pytest.xfail("nothing prevents it: docs/lab/vision.md")
    check(name, stack)


def test_there_are_as_many_faults_as_are_promised():
    assert len(BY_NAME) == len(FAULTS) >= 40
