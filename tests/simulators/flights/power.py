"""Battery and motor heat.

Battery: a lithium cell string as an electrochemical equivalent (open-circuit voltage over state of charge from a
logistic tail, ohmic resistance, one diffusion RC pair). Heat: two nodes per motor (winding, case) that exchange heat.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .craft import Array


@dataclass
class Battery:
    """State of ``n`` packs; voltages in V, charge in A s."""

    cells: Array
    charge: Array
    capacity: Array
    resistance: Array
    diffusion_r: Array
    diffusion_s: Array
    fixed_v: Array  # NaN, or the voltage of a regulated supply
    diffusion_v: Array
    volts: Array

    @classmethod
    def fresh(cls, n: int, cells: int, fixed_v: Array, weak: Array) -> Battery:
        """Good packs; where ``weak`` is above 1, packs with that many times the resistance and less charge."""
        one = np.ones(n)
        capacity = 3600.0 * 16.0 / (1.0 + 2.0 * (weak - 1.0))
        pack = cls(
            cells * one, 0.97 * capacity, capacity, 0.004 * cells * weak, 0.003 * cells * weak, 40.0 * one, fixed_v,
            np.zeros(n), np.zeros(n),
        )  # fmt: skip
        pack.step(0.0, 25.0 * one)
        return pack

    def step(self, dt: float, current: Array) -> None:
        """Draw ``current`` [A] for ``dt`` [s]."""
        self.charge = self.charge - current * dt
        soc = np.clip(self.charge / self.capacity, 0.0, 1.0)
        self.diffusion_v = self.diffusion_v + dt / self.diffusion_s * (
            current * self.diffusion_r - self.diffusion_v
        )
        open_v = self.cells * (
            3.68 + 0.45 * soc**1.3 + 0.08 * np.tanh(12.0 * (soc - 0.08)) - 0.04 * (1.0 - soc)
        )
        volts = open_v - current * self.resistance - self.diffusion_v
        self.volts = np.where(np.isnan(self.fixed_v), volts, self.fixed_v)


@dataclass
class Heat:
    """Winding and case temperatures [deg C] per fan, shape (fans, n)."""

    ambient: Array
    winding: Array
    case: Array
    watts_per_thrust15: Array
    to_case: float = 0.55  # W/K
    to_air: float = 1.1
    winding_j_k: float = 9.0
    case_j_k: float = 45.0

    @classmethod
    def warm(cls, fans: int, ambient: Array, hot: Array) -> Heat:
        """Motors a little above ambient; ``hot`` scales the copper loss."""
        start = np.tile(ambient, (fans, 1)) + 14.0
        return cls(ambient, start.copy(), start.copy() - 2.0, hot)

    def step(self, dt: float, load: Array) -> None:
        """``load`` = thrust over hover thrust, (fans, n)."""
        copper = 12.0 * self.watts_per_thrust15 * load**1.5 * (1.0 + 0.0039 * (self.winding - 25.0))
        flow = self.to_case * (self.winding - self.case)
        self.winding = self.winding + dt / self.winding_j_k * (copper - flow)
        self.case = self.case + dt / self.case_j_k * (
            flow - self.to_air * (self.case - self.ambient)
        )
