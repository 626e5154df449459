"""What a vehicle is: its file, its records, its frame and motor outputs, and first numbers for a new one."""

from models.vehicle.vehicle import (
    RHO_SEA_LEVEL,
    Fan,
    Limits,
    Rangefinder,
    Rotor,
    Throttle,
    Vane,
    Vector3,
    Vehicle,
)
from models.vehicle.vehicle_file import load_vehicle, parse_vehicle

__all__ = [
    "RHO_SEA_LEVEL",
    "Fan",
    "Limits",
    "Rangefinder",
    "Rotor",
    "Throttle",
    "Vane",
    "Vector3",
    "Vehicle",
    "load_vehicle",
    "parse_vehicle",
]
