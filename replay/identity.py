"""What tells a vehicle from others."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class VehicleIdentity:
    """What tells a vehicle from others; empty where a log does not say it."""

    vehicle: str
    """The key: by the board, else by the offsets of its accelerometers, else by frame and number."""
    board: str
    firmware: str
    frame: str
    parameters: str
    """Hash of all parameters that stay as somebody set them."""

    def as_json(self) -> dict[str, str]:
        """Plain values."""
        return {
            "vehicle": self.vehicle,
            "board": self.board,
            "firmware": self.firmware,
            "frame": self.frame,
            "parameters": self.parameters,
        }
