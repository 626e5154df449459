"""Undeclared effects that are in no catalogue, each with the channels that carry it (contract, section 6)."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from .craft import GRAVITY, VANE_NEUTRAL, VANE_RAD_PER_US, Craft
from .effects import Effect, Rng, signed

if TYPE_CHECKING:
    from .world import World


class UnlistedForce(Effect):
    """Base: an effect outside the catalogue. ``channels``: any of them is a right answer (a trailing * is a prefix)."""

    channels: ClassVar[tuple[str, ...]]

    def newtons(self, share: float) -> float:
        """A share of the weight [N]."""
        return share * self.craft.mass_kg * GRAVITY


def _size(rng: Rng, low: float = 0.025, high: float = 0.045) -> float:
    return signed(rng, low, high)


class HeadingForce(UnlistedForce):
    """A vertical force that swings twice per turn of the vehicle."""

    name = "x_heading_force"
    channels = ("yaw_rad",)

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"share": _size(rng), "phase": float(rng.uniform(0.0, 2.0 * np.pi))}

    def loads(self, s: World) -> None:
        s.force[2, self.i] += (
            self.newtons(1.0) * self.p["share"] * np.sin(2.0 * s.yaw[self.i] + self.p["phase"])
        )


class Hum(UnlistedForce):
    """A side force periodic in time, at a frequency tied to nothing."""

    name = "x_hum"
    channels = ("time_s",)

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"share": _size(rng), "hz": float(rng.uniform(0.25, 0.7))}

    def loads(self, s: World) -> None:
        s.force[0, self.i] += (
            self.newtons(1.0) * self.p["share"] * np.sin(2.0 * np.pi * self.p["hz"] * s.t)
        )


class NorthForce(UnlistedForce):
    """A vertical force that depends on where the vehicle is along north, like a grating in the floor."""

    name = "x_north_force"
    channels = ("north_m",)
    blocks = ("lateral", "wobble")

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"share": _size(rng), "width": float(rng.uniform(0.25, 0.4))}

    def loads(self, s: World) -> None:
        s.force[2, self.i] += (
            self.newtons(1.0) * self.p["share"] * np.tanh(s.p[0, self.i] / self.p["width"])
        )


class CurrentYaw(UnlistedForce):
    """The supply cable's field turns the hull: yaw torque with battery current, which a heater switches besides."""

    name = "x_current_yaw"
    channels = ("battery_current_a",)

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"share": signed(rng, 0.006, 0.010), "period": float(rng.uniform(13.0, 23.0))}

    def loads(self, s: World) -> None:
        i = self.i
        s.aux_current[i] = np.where((s.t / self.p["period"]) % 1.0 < 0.45, 9.0, 0.0)
        torque = self.newtons(1.0) * self.p["share"] * 0.3
        s.moment[2, i] += torque * (s.current[i] - 30.0) / 5.0


class RateHysteresis(UnlistedForce):
    """The stream flips sides with the sign of the rotors' acceleration: a forward force with rpm rate."""

    name = "x_rpm_rate"
    channels = ("rpm_*", "servo_*", "thrust_command", "az_m_s2")
    blocks = ("vertical",)

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"share": _size(rng)}

    def start(self, s: World) -> None:
        self.slow = s.fan_rpm[:, self.i].mean(axis=0)

    def loads(self, s: World) -> None:
        mean = s.fan_rpm[:, self.i].mean(axis=0)
        self.slow = self.slow + s.dt / 0.15 * (mean - self.slow)
        s.force[0, self.i] += (
            self.newtons(1.0) * self.p["share"] * np.tanh((mean - self.slow) / 20.0)
        )


class LatePull(UnlistedForce):
    """A side force that sets in long after take-off and stays: a hose that ices up."""

    name = "x_late_pull"
    channels = ("time_s",)

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"share": _size(rng, 0.03, 0.05), "at_s": float(rng.uniform(60.0, 100.0))}

    def loads(self, s: World) -> None:
        grown = 1.0 - np.exp(-np.maximum(s.t - self.p["at_s"], 0.0) / 8.0)
        s.force[1, self.i] += self.newtons(1.0) * self.p["share"] * grown


class PressurePulse(UnlistedForce):
    """Doors slam in the building: a vertical force with the cabin's pressure, which wanders by a few hPa."""

    name = "x_pressure"
    channels = ("pressure_pa",)

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"share": _size(rng), "period": float(rng.uniform(11.0, 19.0))}

    def loads(self, s: World) -> None:
        i = self.i
        phase = s.t / self.p["period"]
        wave = np.tanh(3.0 * np.sin(2.0 * np.pi * phase)) * np.cos(2.0 * np.pi * 0.137 * phase)
        s.cabin_pa[i] = 250.0 * wave
        s.force[2, i] += self.newtons(1.0) * self.p["share"] * wave


class Shelf(UnlistedForce):
    """Standing layers of air: a side force that waves with height, at all distances from the floor."""

    name = "x_height_wave"
    channels = ("down_m", "range_down_m")
    blocks = ("vertical",)

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"share": _size(rng), "wave_m": float(rng.uniform(0.45, 0.7))}

    def loads(self, s: World) -> None:
        i = self.i
        s.force[0, i] += (
            self.newtons(1.0) * self.p["share"] * np.sin(2.0 * np.pi * s.p[2, i] / self.p["wave_m"])
        )


class VaneFlap(UnlistedForce):
    """Vanes that lift their stream: a vertical force with the square of the deflection."""

    name = "x_vane_square"
    channels = ("servo_5", "servo_6")

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"share": _size(rng)}

    def loads(self, s: World) -> None:
        i = self.i
        deflection = (s.vane_us[:, i] - VANE_NEUTRAL) * VANE_RAD_PER_US
        s.force[2, i] += (
            self.newtons(1.0) * self.p["share"] * np.tanh((deflection / 0.06) ** 2).mean(axis=0)
        )


UNLISTED: dict[str, type[UnlistedForce]] = {
    kind.name: kind
    for kind in (
        HeadingForce, Hum, NorthForce, CurrentYaw, RateHysteresis, LatePull, PressurePulse, Shelf, VaneFlap,
    )
}  # fmt: skip
