"""The vehicle files that ship: the paper's tandem (the default) and a 4-fan quadrotor."""

from __future__ import annotations

from pathlib import Path

from models.vehicle import Vehicle, load_vehicle

_HERE = Path(__file__).parent
TANDEM = _HERE / "tandem.toml"
QUAD = _HERE / "quad.toml"


def default_vehicle() -> Vehicle:
    """The paper's tandem coaxial ducted fan."""
    return load_vehicle(TANDEM)
