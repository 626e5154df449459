"""Why nothing is learned for a while."""

from __future__ import annotations

from enum import Enum


class Pause(Enum):
    """Why nothing is learned now; the value is what the pilot reads."""

    NO_IMU = "no accelerometer"
    NO_ROTORS = "rotor speeds missing or old"
    STALE = "attitude or position old"
    NOT_FLYING = "not flying, or taking off or landing"
    SURFACE_UNKNOWN = "a range is not believed"
    SURFACE_STEP = "ground or wall jumped"
    CONTACT = "so near that it may touch"
    UNMODELLED = "near ground or wall, and the model does not cover them"
    OUTSIDE = "outside the data of the model"
    TILTED = "tilted beyond 30 degrees"
    CLIPPED = "bump, or accelerometer clipped"
    EXTERNAL = "an external force: the vehicle is held or touched"
