"""The flight program beside others on one link, all real processes; skipped where a program is not installed.

``pip install MAVProxy mavsdk``; mavlink-router is built from its source or comes with the distribution.
"""

from __future__ import annotations

import importlib.util
import socket
import subprocess
import sys
import threading
import time

import pytest
from neighbours import Companion, Station, companion, missing, running, wired

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

MAVSDK = """
import sys, time
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.telemetry import Telemetry
sdk = Mavsdk(Configuration.create_with_component_type(ComponentType[sys.argv[2]]))
sdk.add_any_connection("udpin://127.0.0.1:" + sys.argv[1])
vehicle = sdk.first_autopilot(60.0)
assert vehicle is not None
telemetry = Telemetry(vehicle)
places = []
telemetry.subscribe_position_velocity_ned(lambda place, _: places.append(place))
while True:
    telemetry.set_rate_position_velocity_ned(2.0)
    print(len(places), flush=True)
    time.sleep(5.0)
"""


def need(kind: str) -> None:
    why = missing(kind)
    if why is not None:
        pytest.skip(why)


def move(station: Station, height: float) -> None:
    """A target of the station moves the hold of the flight program."""
    north, east, _ = station.place
    station.go(north, east, height)
    station.until(
        lambda: abs(station.place[2] - height) < 0.15, 40.0, "the height that was asked for"
    )


def compensates(station: Station, flying: Companion) -> None:
    station.take_off()
    station.until(lambda: "compensating" in flying.words, 40.0, "offsets")


@pytest.mark.parametrize("kind", ["mavlink-router", "mavproxy"])
def test_it_flies_behind_a_hub(kind, tmp_path):
    """Behind mavlink-router stations hear it and move its hold. MAVProxy lets outputs speak with the vehicle alone."""
    need(kind)
    with wired(kind, tmp_path) as (station, flying, _):
        compensates(station, flying)
        if kind == "mavlink-router":
            move(station, 1.9)
            beat = station.of("HEARTBEAT", 191)[-1]
            assert (beat.get_srcSystem(), beat.type, beat.autopilot) == (1, 18, 8)
        else:
            station.until(
                lambda: "to a lower rate again and again" in flying.words,
                60.0,
                "the rates to be set back",
            )
        result = flying.end()
    assert result["messages"]["bad"] == 0
    assert result["compensated_s"] > 1.0
    assert bool(result["set_back"]) == (kind == "mavproxy")
    assert not result["slow_messages_hz"]


@pytest.mark.parametrize("kind", ["GROUND_STATION", "COMPANION_COMPUTER"])
def test_mavsdk_beside_it_asks_for_other_rates(kind, tmp_path):
    need("mavlink-router")
    if importlib.util.find_spec("mavsdk") is None:
        pytest.skip("mavsdk is not installed")
    with wired("mavlink-router", tmp_path, more=1) as (station, flying, (port,)):
        compensates(station, flying)
        with running(
            [sys.executable, "-c", MAVSDK, str(port), kind], stdout=subprocess.PIPE
        ) as other:
            assert other.stdout is not None
            said = [int(other.stdout.readline()) for _ in range(4)]
        move(station, 1.9)
        result = flying.end()
    assert said[-1] > 0, "MAVSDK hears the vehicle"
    assert result["set_back"]["LOCAL_POSITION_NED"] >= 2
    assert "another program is component 191" not in flying.words


def test_two_flight_programs_behind_one_router_do_not_throw_the_vehicle(tmp_path):
    need("mavlink-router")
    with (
        wired("mavlink-router", tmp_path, "--no-offsets", more=1) as (station, flying, (port,)),
        companion(tmp_path, port, "--no-offsets") as second,
    ):
        station.take_off()
        station.until(
            lambda: "holding" in flying.words and "holding" in second.words, 40.0, "both to hold"
        )
        start = station.place
        time.sleep(8.0)
        away = max(abs(a - b) for a, b in zip(station.place, start, strict=True))
        results = flying.end(), second.end()
    assert all(r["commands"] > 100 for r in results)
    assert away < 0.5


def test_a_neighbour_that_floods_the_port_takes_nothing_away(tmp_path):
    """Good heartbeats and rubbish, 3 000 a second, straight to the port of the flight program."""
    need("mavlink-router")
    with wired("mavlink-router", tmp_path) as (station, flying, _):
        compensates(station, flying)
        over = threading.Event()

        def flood() -> None:
            beat = station.link.mav.heartbeat_encode(6, 8, 0, 0, 0).pack(station.link.mav)
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as neighbour:
                while not over.wait(0.01):
                    for k in range(30):
                        neighbour.sendto(
                            beat if k % 2 else b"\xfd" + bytes(200), ("127.0.0.1", flying.port)
                        )

        thread = threading.Thread(target=flood)
        thread.start()
        try:
            time.sleep(3.0)
            move(station, 1.9)
        finally:
            over.set()
            thread.join()
        result = flying.end()
    assert result["messages"]["ignored"] > 2000
    assert not result["slow_messages_hz"]
