"""Frames by the numbers and texts of ArduPilot and PX4: places, spins, and what is not known."""

import math

import pytest

from models.vehicle.ardupilot_frames import (
    COUNT_OF_CLASS,
    ardupilot_frame,
    said_before_3_5,
    said_by_class,
    said_by_text,
)
from models.vehicle.motor_layouts import FRAMES
from models.vehicle.px4_frames import px4_rotors, said_by_autostart

CLOCKWISE, COUNTER = 1, -1


def named(frame_class: float, frame_type: float) -> str | None:
    return ardupilot_frame({"FRAME_CLASS": frame_class, "FRAME_TYPE": frame_type})


def angles(name: str) -> list[float]:
    """Of the motors, clockwise from the nose [deg], in order of their numbers."""
    return [round(math.degrees(math.atan2(m.right, m.forward)), 1) for m in FRAMES[name]]


@pytest.mark.parametrize(
    ("frame_class", "types"),
    [
        (1, (0, 1, 2, 3, 4, 5, 6, 12, 13, 14, 16, 17, 18, 19)), (2, (0, 1, 3, 13, 14)),
        (3, (0, 1, 2, 3, 13, 14, 15)), (4, (0, 1, 2, 3, 12, 14, 18, 20, 21)), (5, (0, 1, 10, 11)),
        (7, (0, 1, 6)), (12, (0, 1)), (14, (0, 1, 14)),
    ],
)  # fmt: skip
def test_every_frame_of_ardupilot_has_places(frame_class, types):
    for frame_type in types:
        motors = FRAMES[named(frame_class, frame_type)]
        assert len(motors) == COUNT_OF_CLASS[frame_class]
        assert max(math.hypot(m.forward, m.right) for m in motors) == pytest.approx(1.0)
        assert len({m.number for m in motors}) == len(motors)


@pytest.mark.parametrize(
    ("name", "wanted", "spins"),
    [
        ("quad-v", [45, -135, -45, 135], "lLrR"),
        ("quad-h", [45, -135, -45, 135], "rRlL"),
        ("quad-plus-reversed", [90, -90, 0, 180], "rrll"),
        ("quad-y4", [45, 180, 180, -45], "lrlr"),
        ("hexa-h", [90, -90, -45, 135, 45, -135], "rlrllr"),
        ("octo-i", [-161.6, 18.4, -135, -18.4, 161.6, 45, 135, -45], "rrllllrr"),
        ("octo-h", [45, -135, 71.6, 135, -45, -108.4, -71.6, 108.4], "rrllllrr"),
        ("y6f", [180, 60, -60, 180, 60, -60], "lllrrr"),
        ("octaquad-bf", [135, 45, -135, -45, 135, 45, -135, -45], "rllrlrrl"),
        ("octaquad-clockwise-corotating", [45, 45, 135, 135, -135, -135, -45, -45], "llrrllrr"),
        ("deca-x", [18, 54, 90, 126, 162, -162, -126, -90, -54, -18], "lrlrlrlrlr"),
    ],
)
def test_places_and_spins_are_those_of_the_firmware(name, wanted, spins):
    assert angles(name) == wanted
    assert [m.spin for m in FRAMES[name]] == [CLOCKWISE if s in "rR" else COUNTER for s in spins]


def test_a_v_frame_yaws_less_with_its_front_motors():
    assert [m.yaw for m in FRAMES["quad-v"]] == [0.7981, 1.0, 0.7981, 1.0]
    assert [m.yaw for m in FRAMES["quad-x"]] == [1.0] * 4


def test_a_tricopter_has_motors_1_2_and_4():
    assert [m.number for m in FRAMES[named(7, 0)]] == [1, 2, 4]
    assert angles(named(7, 6)) == [120, -120, 0]


@pytest.mark.parametrize(
    ("frame_class", "frame_type", "words"),
    [
        (1, 21, "FRAME_TYPE 21 of FRAME_CLASS 1 is not known"),
        (2, 2, "FRAME_TYPE 2 of FRAME_CLASS 2 is not known"),
        (99, 1, "FRAME_CLASS 99 is not known"),
        (17, 1, "script"),
    ],
)
def test_a_number_that_is_in_no_list_is_said(frame_class, frame_type, words):
    said = said_by_class({"FRAME_CLASS": frame_class, "FRAME_TYPE": frame_type})
    assert said.name is None
    assert words in said.unsure


def test_a_frame_class_that_was_never_set_says_nothing():
    assert said_by_class({"FRAME_CLASS": 0.0, "FRAME_TYPE": 1.0}) is None


@pytest.mark.parametrize(
    ("value", "count", "name"),
    [
        (0, 4, "quad-plus"), (1, 4, "quad-x"), (2, 4, "quad-v"), (3, 4, "quad-h"), (4, 4, "quad-vtail"),
        (5, 4, "quad-atail"), (10, 4, "quad-x"), (0, 6, "hexa-plus"), (1, 6, "hexa-x"), (10, 6, "y6b"),
        (11, 6, "y6f"), (0, 8, "octo-plus"), (1, 8, "octo-x"), (2, 8, "octo-v"), (1, 3, "tri"),
    ],
)  # fmt: skip
def test_one_parameter_says_the_frame_before_3_5(value, count, name):
    said = said_before_3_5({"FRAME": value}, [], count)
    assert (said.name, len(FRAMES[said.name])) == (name, count)


def test_a_hexa_and_a_y6_of_old_firmware_are_told_apart_by_the_start_up_text():
    alone = said_before_3_5({"FRAME": 1.0}, [], 6)
    assert (alone.name, "Y6" in alone.unsure) == ("hexa-x", True)
    hexa = said_before_3_5({"FRAME": 1.0}, ["APM:Copter V3.3.3", "Frame: HEXA"], 6)
    assert (hexa.name, hexa.unsure) == ("hexa-x", "")
    y6 = said_before_3_5({"FRAME": 1.0}, ["Frame: Y6"], 6)
    assert (y6.name, y6.unsure) == ("y6", "")
    x8 = said_before_3_5({"FRAME": 3.0}, ["Frame: OCTA_QUAD"], 8)
    assert (x8.name, x8.unsure) == ("octaquad-h", "")


@pytest.mark.parametrize(
    ("text", "name", "count"),
    [
        ("Frame: QUAD/X", "quad-x", 4), ("Frame: HEXA/PLUS", "hexa-plus", 6), ("Frame: Y6/default", "y6", 6),
        ("Frame: OCTAQUAD/X_COR", "octaquad-x-corotating", 8), ("Frame: DECA/X/CW_X", "deca-x", 10),
        ("Frame: QUAD", None, 4), ("Frame: QUAD/X_REV", "quad-bf-reversed", 4),
    ],
)  # fmt: skip
def test_the_start_up_text_says_the_frame(text, name, count):
    said = said_by_text(["ArduCopter V4.5.7", text])
    assert (said.name, said.count, bool(said.unsure)) == (name, count, name is None)


@pytest.mark.parametrize(
    ("number", "name", "count"),
    [
        (4001, "quad-x", 4), (5001, "quad-plus", 4), (6001, "hexa-x", 6), (7001, "hexa-plus", 6),
        (8001, "octo-x", 8), (9001, "octo-plus", 8), (10016, "quad-wide", 4), (11001, "y6b", 6),
        (12001, "octaquad-x", 8), (4040, "quad-h", 4), (4900, "quad-clockwise", 4), (4999, None, 4),
    ],
)  # fmt: skip
def test_airframe_numbers_of_old_px4(number, name, count):
    said = said_by_autostart({"SYS_AUTOSTART": number})
    assert (said.name, said.count, bool(said.unsure)) == (name, count, name is None)


@pytest.mark.parametrize("number", [0, 2100, 13000, 22001, 50000])
def test_airframe_numbers_of_no_multirotor_say_no_frame(number):
    assert said_by_autostart({"SYS_AUTOSTART": number}) is None


def rotors(*places: tuple[float, float, float], **more: float) -> dict[str, float]:
    """CA_ROTORn of PX4 from (forward, right, KM)."""
    out = {"CA_ROTOR_COUNT": float(len(places))}
    for k, (forward, right, km) in enumerate(places):
        out |= {f"CA_ROTOR{k}_PX": forward, f"CA_ROTOR{k}_PY": right, f"CA_ROTOR{k}_KM": km}
    return out | more


X_OF_PX4 = ((0.15, 0.16, 0.05), (-0.15, -0.16, 0.05), (0.15, -0.16, -0.05), (-0.15, 0.16, -0.05))


def test_places_of_px4_get_the_name_of_the_frame_that_they_are():
    assert px4_rotors(rotors(*X_OF_PX4)).name == "quad-x"
    other_way = tuple((x, y, -km) for x, y, km in X_OF_PX4)
    assert px4_rotors(rotors(*other_way)).name == "quad-h"
    iris = (
        (0.1515, 0.245, 0.05),
        (-0.1515, -0.1875, 0.05),
        (0.1515, -0.245, -0.05),
        (-0.1515, 0.1875, -0.05),
    )
    assert px4_rotors(rotors(*iris)).name == "quad-wide"
    bent = ((0.3, 0.1, 0.05), *X_OF_PX4[1:])
    assert px4_rotors(rotors(*bent)).name == "4 rotors of CA_ROTORn"


def test_tilted_rotors_of_px4_are_said():
    tilted = px4_rotors(rotors(*X_OF_PX4, CA_ROTOR1_AY=0.7, CA_ROTOR1_AZ=-0.7))
    assert "CA_ROTOR1_AX" in tilted.unsure
    no_spin = px4_rotors(rotors(*X_OF_PX4[:3], (-0.15, 0.16, 0.0)))
    assert "CA_ROTOR3_KM is 0" in no_spin.unsure
    assert px4_rotors(rotors(*X_OF_PX4)).unsure == ""
