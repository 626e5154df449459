"""A flight in numbers, and why nothing was flown at all."""

from __future__ import annotations

from typing import Any

from companion.flight.incoming import Incoming
from companion.flight.requests import Requests
from companion.mavlink.link import Link
from companion.mavlink.message_filter import Intake
from companion.mavlink.tlog_writer import Recorder, Records


def why_unheard(link: Link, target_system: int | None) -> str:
    """Why no autopilot was heard, in words."""
    if not link.received and not link.bad:
        return "nothing was heard; does the autopilot send there?"
    if not link.received:
        return (
            f"{link.bad} damaged or unsigned frames and no good one: "
            "check baud rate and signing key"
        )
    who = ""
    if target_system:
        who = f" of system {target_system}"
    return (
        f"{link.received} messages but no HEARTBEAT of an autopilot{who}: check "
        "--target-system, routing"
    )


def as_json(
    *,
    link: Link,
    recorder: Records | None,
    intake: Intake,
    incoming: Incoming,
    requests: Requests,
    dry_run: bool,
) -> dict[str, Any]:
    """Link, messages and streams."""
    messages = {
        "received": link.received,
        "sent": link.sent,
        "bad": link.bad,
        "dropped": link.dropped,
        "ignored": intake.ignored,
    }
    record = None
    if isinstance(recorder, Recorder):
        record = recorder.as_json()
    return {
        "endpoint": link.endpoint,
        "system": intake.system,
        "autopilot": requests.stack.name.lower(),
        "dry_run": dry_run,
        "messages": messages,
        "reboots": incoming.reboots,
        "ignored_systems": sorted(intake.others),
        "latency_ms": incoming.latencies.percentiles_ms(),
        "record": record,
        "slow_messages_hz": dict(requests.streams.in_vain),
        "set_back": dict(requests.streams.set_back),
    }
