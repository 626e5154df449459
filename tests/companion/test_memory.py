"""Memory of the flight loop does not grow with the messages it has seen."""

from __future__ import annotations

import gc
import tracemalloc

import pytest

import models
from companion.config import PipelineConfig
from companion.flight.latency import Latencies
from companion.flight.loop import Flight
from companion.flight.options import FlightOptions
from companion.mavlink.dialect import mavlink
from companion.mavlink.link import Arrivals
from companion.mavlink.wire_frames import FrameReader
from companion.vehicles import default_vehicle


class Wire:
    """A link without a socket: keeps nothing of what is sent."""

    endpoint, received, sent, bad, dropped = "test", 0, 0, 0, 0

    def __init__(self):
        self.mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)

    def identify(self, system, component):
        pass

    def send(self, message_id, payload):
        self.sent += 1
        return b""


def cycle(mav, tick):
    """One cycle of 20 ms of a hovering vehicle, as frames."""
    ms, h = 20_000 + 20 * tick, 0.4
    messages = (
        mav.heartbeat_encode(2, 3, 137, 4, 4),
        mav.extended_sys_state_encode(0, 2),
        mav.param_value_encode(b"GUID_OPTIONS", 8.0, 6, 1, 0),
        mav.esc_telemetry_1_to_4_encode(
            [20] * 4, [0] * 4, [0] * 4, [0] * 4, [4000] * 4, [tick % 65536] * 4
        ),
        mav.distance_sensor_encode(ms, 5, 4000, round((h - 0.05) * 100) + tick % 2, 0, 0, 25, 0),
        mav.distance_sensor_encode(ms, 5, 4000, 60 + tick % 2, 0, 1, 2, 0),
        mav.local_position_ned_encode(ms, 0, 0, -h, 0, 0, 0),
        mav.attitude_quaternion_encode(ms, 1, 0, 0, 0, 0, 0, 0),
    )
    return b"".join(bytes(m.pack(mav)) for m in messages)


@pytest.mark.slow
def test_a_long_flight_needs_no_more_memory_than_a_short_one():
    wire, reader = Wire(), FrameReader()
    config = PipelineConfig(vehicle=default_vehicle(), model=models.load())
    flight = Flight(config=config, link=wire, arrivals=Arrivals(), options=FlightOptions())
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    sent = [cycle(mav, tick) for tick in range(1800)]

    def fly(first, count):
        for tick in range(first, first + count):
            for frame in reader.feed(sent[tick]):
                flight.incoming.take(10**15 + tick * 20_000, frame)

    fly(0, 300)
    tracemalloc.start()
    fly(300, 900)  # the state that is alive is traced from here on; its longest memory is of 12 s
    gc.collect()
    before, _ = tracemalloc.get_traced_memory()
    fly(1200, 600)
    gc.collect()
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert wire.sent > 1000
    assert after - before < 4_000, "4800 messages leave nothing behind"


def latencies(*took_us):
    out = Latencies()
    for one in took_us:
        out.add(one)
    return out


def test_percentiles_of_latencies():
    assert latencies().percentiles_ms() is None
    assert latencies(*range(0, 1000, 10)).percentiles_ms() == {"p50": 0.5, "p99": 0.99}
    slow = latencies(*[30] * 90, *[20_000] * 10)
    assert slow.percentiles_ms() == {"p50": 0.04, "p99": 20.01}
    assert latencies(-5).percentiles_ms() == {"p50": 0.01, "p99": 0.01}
    assert latencies(10**9).percentiles_ms() == {"p50": 100.01, "p99": 100.01}
