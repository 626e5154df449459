"""The vehicle file: one TOML file (docs/formats.md), read and checked."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

from models.common.text_file import read_text
from models.common.toml_table import Table
from models.vehicle.plausibility import findings
from models.vehicle.vehicle import Fan, Limits, Rangefinder, Rotor, Throttle, Vane, Vehicle


def load_vehicle(path: Path | str) -> Vehicle:
    """Read and check a vehicle file.

    Parameters
    ----------
    path : path or str
        A TOML file (docs/vehicle.md).

    Returns
    -------
    Vehicle
        SI units, body FRD.

    Raises
    ------
    ConfigError
        It cannot be read, a key is unknown or missing, a value is impossible, or no such vehicle can be. File and key
        are named.

    Examples
    --------
    >>> from models.vehicle import load_vehicle
    >>> vehicle = load_vehicle("my.toml")
    >>> vehicle.name, vehicle.mass_kg, len(vehicle.rotors)
    ('quadrotor', 3.0, 4)
    """
    return parse_vehicle(read_text("vehicle file", Path(path)), str(path))


def parse_vehicle(text: str, file: str) -> Vehicle:
    """``load_vehicle`` of a text; ``file`` is what errors name."""
    table = Table.of(text, f"vehicle file {file}", _KEYS)
    vehicle = table.read(Vehicle, _NAMES)
    for finding in findings(vehicle):
        if finding.refused:
            raise table.fail(finding.key, finding.text)
    return vehicle


_NAMES = {"fans": "fan", "vanes": "vane", "rangefinders": "rangefinder"}
"""Tables of a file, each of which stands for one."""
_KEYS = {
    f.name
    for kind in (Rotor, Fan, Vane, Throttle, Rangefinder, Limits, Vehicle)
    for f in fields(kind)
}
_KEYS = _KEYS - {*_NAMES} | {*_NAMES.values()}
"""Every key of a vehicle file."""
