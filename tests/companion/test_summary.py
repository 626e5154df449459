"""The summary of a flight: seconds that add up, and a dry run that claims nothing."""

from __future__ import annotations

from companion.control.compensation import Offset
from companion.control.reasons import HOLDS_BACK_EVERYTHING, HoldsBack, Reason
from companion.mavlink.setpoints import AttitudeCommand
from companion.state.decision import Decision
from companion.telemetry.summary import Summary


def decide(summary: Summary, seconds: float, *reasons: Reason, start: float = 0.0) -> float:
    for k in range(round(seconds / 0.1)):
        t = start + 0.1 * k
        command = (
            None
            if set(reasons) & HOLDS_BACK_EVERYTHING
            else AttitudeCommand(t, (1.0, 0.0, 0.0, 0.0), 0.5)
        )
        summary.add(Decision(t, command, reasons, 0.0 if reasons else 1.0, Offset(), None, None))
    return start + seconds


def test_seconds_go_to_the_gravest_reason_and_add_up():
    summary = Summary()
    now = decide(summary, 4.0, Reason.RANGE_MISSING, Reason.LANDED, Reason.NOT_ARMED)
    now = decide(summary, 2.0, Reason.RANGE_MISSING, start=now)
    decide(summary, 3.0, start=now)
    numbers = summary.as_json()
    assert set(numbers["gravest_s"]) == {"not_armed", "range_missing"}
    assert (
        abs(sum(numbers["gravest_s"].values()) + numbers["compensated_s"] - numbers["duration_s"])
        < 0.01
    )
    assert numbers["refusals_s"]["range_missing"] > 5.8
    text = summary.as_text()
    assert f"  2.0 s  {Reason.RANGE_MISSING.value}" in text
    assert f"less grave: {Reason.LANDED.value}" in text


def test_a_dry_run_says_that_nothing_was_sent():
    summary = Summary(dry_run=True)
    decide(summary, 2.0)
    first = summary.as_text().splitlines()[0]
    assert "nothing sent (dry run); would have compensated 1.9 s" in first
    assert "setpoints" not in first


def test_reasons_that_hold_back_everything_come_first():
    order = list(Reason)
    last_grave = max(order.index(r) for r in HOLDS_BACK_EVERYTHING)
    assert last_grave == len(HOLDS_BACK_EVERYTHING) - 1


def test_every_reason_says_what_it_holds_back():
    assert Reason.LANDED.holds_back is HoldsBack.EVERYTHING
    assert Reason.RANGE_LOST.holds_back is HoldsBack.OFFSETS
    assert Reason.LANDED.value == "on the ground"


def test_a_zero_has_no_sign():
    summary = Summary()
    summary.add(Decision(0.0, None, (), 1.0, Offset(thrust=-1e-9), None, None))
    assert "0.000" in summary.as_text()
    assert "-0.000" not in summary.as_text()
