"""Record, then replay: the same decisions, bit for bit."""

import dataclasses
import random
from contextlib import closing

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from log_writers import flight, frame, write_tlog

import models
from companion.config import Base, PipelineConfig
from companion.mavlink.dialect import mavlink
from companion.mavlink.message_filter import Intake
from companion.mavlink.tlog_writer import Recorder
from companion.mavlink.wire_frames import FrameReader, cut
from companion.pipeline import answer, initial_state
from companion.settle import settle
from companion.vehicles import default_vehicle
from replay.logs.formats import load
from replay.logs.tlog import read_tlog
from replay.rerun.harness import Replay
from replay.rerun.log_samples import samples

CONFIG = PipelineConfig(vehicle=default_vehicle(), model=models.load())


def numbers(value):
    """A decision as nested plain values, floats by their bits."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return [numbers(getattr(value, f.name)) for f in dataclasses.fields(value)]
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if isinstance(value, tuple | list):
        return [numbers(v) for v in value]
    return value.hex() if isinstance(value, float) else value


def live(messages, path, config, cuts):
    """Decide as in flight: bytes in arbitrary pieces through the link's reader, both directions into the recorder."""
    reader, intake, state = FrameReader(), Intake(), initial_state(config)
    decisions, number = [], 0
    with closing(Recorder(path)) as recorder:
        for arrival, raw in messages:
            split = cuts[number % len(cuts)] % len(raw)
            number += 1
            for arrived in (*reader.feed(raw[:split]), *reader.feed(raw[split:])):
                recorder.write(arrival, arrived.raw)
                sample = intake.sample(arrived, arrival)
                if sample is None:
                    continue
                state, decision = answer(state, sample, config)
                # Here flight sends the setpoint.
                state = settle(state, sample, decision, config)
                if decision is not None:
                    decisions.append(decision)
                    # What is sent is recorded too, and must not be taken for input.
                    out = mavlink.MAVLink_set_attitude_target_message(
                        1, 1, 1, 7, (1, 0, 0, 0), 0, 0, 0, 0.5
                    )
                    recorder.write(arrival + 1, frame(out, 1, 191))
    return decisions


@settings(max_examples=5, deadline=None)
@given(
    st.integers(0, 2**32),
    st.lists(st.integers(0, 40), min_size=1, max_size=5),
    st.booleans(),
    st.sampled_from([Base.HOLD, Base.UPSTREAM]),
)
def test_replay_decides_what_flight_decided(tmp_path_factory, seed, cuts, px4, base):
    rng = random.Random(seed)
    messages = flight(
        1.6, px4=px4, start_ms=rng.randrange(1, 2**32)
    )  # the clock may wrap on the way
    upstream = mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, (1, 0, 0, 0), 0, 0, 0, 0.5)
    messages += [(messages[0][0] + 20_000 * k + 7, frame(upstream, 255, 190)) for k in range(80)]
    messages.sort(key=lambda item: item[0])
    # Late and lost messages, a reboot now and then.
    messages = [
        (a + rng.randrange(0, 3000), raw)
        for a, raw in messages
        if rng.random() > 0.05 or cut(raw, 0).id == 0
    ]
    if rng.random() < 0.5:
        messages += flight(1.0, px4=px4, start_ms=900, arrival_us=messages[-1][0] + 4_000_000)
    config = dataclasses.replace(CONFIG, base=base)
    path = tmp_path_factory.mktemp("live") / "live.tlog"
    flown = live(messages, path, config, cuts)
    replay = Replay(config)
    replayed = list(replay.decisions(read_tlog(path).frames()))
    assert len(flown) > 10
    assert [numbers(d) for d in replayed] == [numbers(d) for d in flown]


def test_replay_twice_is_the_same(tmp_path):
    messages = flight(1.0)
    first = [numbers(d) for d in Replay(CONFIG).decisions(messages)]
    assert first == [numbers(d) for d in Replay(CONFIG).decisions(messages)]
    assert 40 <= len(first) <= 50


def test_assumed_parameters_hold_until_the_log_tells():
    silent = [m for m in flight(2.0) if cut(m[1], 0).id != 22]
    told = flight(2.0)

    def held(messages, assumed):
        reasons = [
            {r.name for r in d.reasons} for d in Replay(CONFIG, None, assumed).decisions(messages)
        ]
        return any("THRUST_IS_CLIMB_RATE" in r for r in reasons), any(
            "THRUST_UNKNOWN" in r for r in reasons[60:]
        )

    assert held(silent, {}) == (False, True)
    assert held(silent, {"GUID_OPTIONS": 8.0}) == (False, False)
    assert held(silent, {"GUID_OPTIONS": 0.0}) == (True, False)
    assert not held(told, {"GUID_OPTIONS": 0.0})[1]


def test_columns_turned_into_samples_decide_alike(tmp_path):
    """The way of .BIN and .ulg, on a .tlog: the same decisions at the same times, but for jitter of arrival."""
    path = tmp_path / "flight.tlog"
    write_tlog(path, flight(4.0))
    direct = list(Replay(CONFIG).decisions(read_tlog(path).frames()))
    (log,) = load(path)
    by_columns = list(Replay(CONFIG).decisions_on(samples(log)))
    late = {d.t_s: d for d in by_columns}
    pairs = [(d, late[d.t_s]) for d in direct if d.t_s in late][60:]
    assert len(pairs) > 100
    assert np.mean([set(a.reasons) == set(b.reasons) for a, b in pairs]) > 0.9
    close = [
        np.allclose(a.disturbance.h_m, b.disturbance.h_m, atol=0.01)
        for a, b in pairs
        if a.disturbance and b.disturbance
    ]
    assert np.mean(close) > 0.95


def test_recorded_flights_of_a_real_autopilot_compensate(shared_data):
    """Half a minute of each: decisions come, times only grow, and the sample kinds are those of the log."""
    from models.vehicle import load_vehicle

    folder = shared_data / "ardupilot"
    for name in ("s1_quad3_ground_wall_corner", "s4_quad3_attitude_target_corner"):
        config = dataclasses.replace(CONFIG, vehicle=load_vehicle(folder / f"{name}.toml"))
        frames = list(read_tlog(folder / f"{name}.tlog").frames())[:6_000]
        replay = Replay(config, assumed={"GUID_OPTIONS": 8.0})
        decisions = list(replay.decisions(frames))
        assert len(decisions) > 300
        assert np.all(np.diff([d.t_s for d in decisions]) > 0.0)
        assert replay.samples["Range"] > 200
