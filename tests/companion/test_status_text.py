"""What the pilot reads: whole words, which range, no repeats, no alarm that is none."""

from __future__ import annotations

import dataclasses

import pytest
from flying import Bench, bench
from hypothesis import given
from hypothesis import strategies as st
from paced_flight import PacedFlight

from companion.control.reasons import Notice, Reason
from companion.mavlink.dialect import mavlink
from companion.mavlink.firmware import Stack
from companion.mavlink.samples import Attitude, Heartbeat
from companion.mavlink.stream_rates import StreamKeeper, wanted_streams
from companion.mavlink.wire_frames import pack
from companion.pipeline import initial_state, step
from companion.telemetry.status import StatusReporter, chunks, text_messages
from companion.vehicles import default_vehicle

MAV = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)


def decoded(sent):
    """As pymavlink reads what was sent."""
    return [MAV.parse_buffer(pack(*message, 1, 191, k))[0] for k, message in enumerate(sent)]


SENTENCES = [r.value for r in Reason] + [n.value for n in Notice]


@given(
    st.lists(st.text("abcdefghij", min_size=1, max_size=49), min_size=1, max_size=30).map(" ".join)
)
def test_chunks_end_between_words_and_join_again(text):
    pieces = chunks(text)
    assert all(len(piece) == 50 for piece in pieces[:-1]), "a piece that is not full ends the text"
    assert 0 < len(pieces[-1]) <= 50
    assert " ".join("".join(pieces).split()) == text


@given(st.text(max_size=300))
def test_any_text_can_be_sent(text):
    for message in decoded(text_messages(4, text, 7)):
        assert len(message.text) <= 50


@pytest.mark.parametrize("sentence", SENTENCES)
def test_no_sentence_is_cut(sentence):
    text = f"companion: no offset, {sentence}"
    sent = decoded(text_messages(4, text, 7))
    joined = "".join(m.text if isinstance(m.text, str) else m.text.decode() for m in sent)
    assert " ".join(joined.split()) == text
    assert [m.chunk_seq for m in sent] == list(range(len(sent)))
    assert all((m.id == 7) is (len(sent) > 1) for m in sent)


def told(b: Bench, seconds: float, reporter: StatusReporter) -> list[str]:
    out = []
    for _ in range(round(seconds / 0.02)):
        decision = b.tick()
        out += [text for _, text in reporter.messages(b.state, decision) if text is not None]
    return out


def test_it_says_which_range_is_old():
    b, reporter = bench(height=0.3), StatusReporter()
    told(b, 4.0, reporter)
    b.send_range = False
    assert told(b, 2.0, reporter) == [
        "companion: no offset, range to the ground and the wall old or invalid"
    ]
    b.send_range, b.wall = True, 60.0
    texts = told(b, 3.0, reporter)
    assert any("range to the wall lost" in text for text in texts), texts


def test_on_attaching_in_the_air_it_is_not_said_to_be_on_the_ground():
    b, reporter = bench(height=1.0), StatusReporter()
    assert not [text for text in told(b, 6.0, reporter) if "on the ground" in text]


def test_the_first_message_names_the_gravest_refusal_and_the_others_follow():
    sent = decoded(
        message
        for message, _ in StatusReporter().tell("companion: no offset, not armed; also: late; slow")
    )
    assert [(m.text, m.id) for m in sent] == [("no offset, not armed", 0), ("late; slow", 0)]


def test_nothing_is_said_twice_for_one_cause():
    b, reporter = bench(armed=False, landed=1, rpm=0.0), StatusReporter()
    texts = told(b, 2.0, reporter)
    b.send_rpm = False
    texts += told(b, 2.0, reporter)
    assert len(texts) == len(set(texts)) <= 2
    assert all(t.startswith("companion: no offset, not armed; also: on the ground") for t in texts)
    b.landed = 2
    (contradiction,) = told(b, 2.0, reporter)
    assert contradiction.startswith(
        "companion: no offset, not armed, though the vehicle flies: nothing is sent"
    )


def test_all_refusals_are_said_and_a_lesser_one_that_flickers_is_not():
    b, reporter = bench(height=0.3), StatusReporter()
    told(b, 4.0, reporter)
    b.mode = 5
    assert told(b, 2.0, reporter) == [
        "companion: no offset, not in GUIDED, GUIDED_NOGPS or OFFBOARD (now LOITER)"
    ]
    b.send_rpm = False
    texts = told(b, 8.0, reporter)
    assert len(texts) == 1
    assert texts[0].endswith("(now LOITER); also: rotor speeds missing or old")
    for _ in range(8):  # one second with, one without
        b.send_rpm = not b.send_rpm
        texts = told(b, 1.0, reporter)
        assert texts == []


def test_a_state_that_comes_and_goes_is_not_repeated_all_the_time():
    b, reporter = bench(height=0.3), StatusReporter()
    texts = []
    for k in range(12):
        b.send_rpm = k % 2 == 0
        texts += told(b, 1.5, reporter)
    assert texts.count("companion: no offset, rotor speeds missing or old") <= 4


def test_late_data_are_told_in_milliseconds():
    b, reporter = bench(height=0.3), StatusReporter()
    told(b, 4.0, reporter)
    b.late = 0.165
    assert "companion: no offset, telemetry arrives late (165 ms)" in told(b, 2.0, reporter)


def test_a_heartbeat_before_the_first_stamp_counts():
    """Before the autopilot stamped a message the axis is unknown, and times are 0."""
    b = bench()
    state, _ = step(initial_state(b.config), Heartbeat(0.0, 1, 1, True, 4, 3, 2), b.config)
    state, decision = step(
        state, Attitude(4321.0, 1, 1, (1.0, 0.0, 0.0, 0.0), (0, 0, 0), "ATTITUDE"), b.config
    )
    assert Reason.NO_HEARTBEAT not in decision.reasons
    later = Attitude(4326.0, 1, 1, (1.0, 0.0, 0.0, 0.0), (0, 0, 0), "ATTITUDE")
    assert Reason.NO_HEARTBEAT in step(state, later, b.config)[1].reasons


def test_a_needed_message_that_stays_slow_is_named():
    keeper = StreamKeeper(wanted_streams(default_vehicle(), Stack.ARDUPILOT, recorded=True))
    now = 0.0
    while now < 9.0:
        for wanted in keeper.wanted:
            if (
                wanted.message_id != mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
                or round(now * 50) % 5 == 0
            ):
                keeper.heard(wanted.message_id)
        keeper.due(now)
        now += 0.02
    assert keeper.in_vain == {"LOCAL_POSITION_NED": pytest.approx(10.0, abs=1.0)}


def test_a_rate_that_another_station_sets_back_is_asked_for_at_once_and_said():
    keeper = StreamKeeper(wanted_streams(default_vehicle(), Stack.ARDUPILOT))
    attitude, position = (
        mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    )
    slow_since, waited, back = None, [], 5.3
    for k in range(1, 60 * 50):
        now = k / 50
        if now >= back:  # every 15 s, in place of what was asked for
            slow_since, back = now, back + 15.0
        for wanted in keeper.wanted:
            if wanted.message_id != position or slow_since is None or k % 12 == 0:
                keeper.heard(wanted.message_id)
        asked = {w.message_id for w in keeper.due(now)}
        assert now < 0.1 or attitude not in asked
        if slow_since is not None and position in asked:
            waited.append(now - slow_since)
            slow_since = None
    assert len(waited) == 4
    assert max(waited) < 0.8
    assert keeper.set_back == {"LOCAL_POSITION_NED": 4}
    assert not keeper.in_vain, "every request was answered"


def test_silence_is_not_a_rate_set_back():
    keeper = StreamKeeper(wanted_streams(default_vehicle(), Stack.ARDUPILOT))
    for k in range(1, 20 * 50):
        if not 8.0 < k / 50 < 10.0:
            for wanted in keeper.wanted:
                keeper.heard(wanted.message_id)
        keeper.due(k / 50)
    assert not keeper.set_back


def test_a_target_for_the_autopilot_is_answered_with_the_right_address():
    with PacedFlight() as run:
        run.wait_for("SET_ATTITUDE_TARGET", 5)
        place = (1.0, 0.0, -1.0)
        target = mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, 0x0DF8, *place, *(0.0,) * 3, *(0.0,) * 3, 0.0, 0.0
        )
        run.autopilot.send(target)
        run.until(lambda: "191 moves the hold" in run.said())
    assert "position targets to component 191" in run.said()


def test_outputs_are_asked_for_only_where_they_are_recorded_or_vanes_need_them():
    vehicle = default_vehicle()
    flown = {w.message_id for w in wanted_streams(vehicle, Stack.ARDUPILOT, recorded=False)}
    kept = {w.message_id for w in wanted_streams(vehicle, Stack.ARDUPILOT, recorded=True)}
    assert kept == flown
    bare = dataclasses.replace(vehicle, vanes=())
    needed = {w.message_id for w in wanted_streams(bare, Stack.ARDUPILOT, recorded=False)}
    assert flown - needed == {mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW}
