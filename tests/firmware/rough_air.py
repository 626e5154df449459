"""Air as rough as in the flights of another simulator on real firmwares: gusts, and a wall that pulls six times harder.

That simulator's wall pulled with 0.06 of the weight times exp(-d / 1.2 r), d of the lip; its gusts had a standard
deviation of 0.15 N on 3 kg, correlated over 0.4 s. The law of ``companion.sim`` comes to the same at 0.15 to 0.3 m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from companion.sim.air import LawConstants, Unsteadiness
from companion.sim.body import Body
from companion.sim.fan_wrench import Vec

WALL_PULL, WALL_REACH = 0.083, 1.2
"""Share of thrust, rotor radii: 0.30 N at 0.30 m, 0.42 N at 0.24 m on the shipped quadrotor."""
GUST_SD_M_S, GUST_S = 0.15, 0.4
"""It has 1.06 N of drag in 1 m/s."""
CORNER_TIMES = 2.0


@dataclass
class RoughBody(Body):
    """The body in that air."""

    gust: Vec = (0.0, 0.0, 0.0)
    """On top of the turbulence, NED [m/s]; may change in flight."""

    def __post_init__(self) -> None:
        assert isinstance(self.law, LawConstants)
        self.law = self.changed(self.law)
        self._gusts = Unsteadiness(f"gusts {self.seed}", 3, self.dt, tau=GUST_S)
        super().__post_init__()

    def change_step(self, dt: float) -> None:
        """Steps of another length [s] from here on."""
        self._gusts.change_step(dt)
        super().change_step(dt)

    def step(self, pwm: Sequence[float]) -> None:
        """Advance by one step under servo outputs [us]."""
        north, east, down = self._gusts.step()
        self.wind = (
            GUST_SD_M_S * north + self.gust[0],
            GUST_SD_M_S * east + self.gust[1],
            GUST_SD_M_S * down + self.gust[2],
        )
        super().step(pwm)

    def changed(self, law: LawConstants) -> LawConstants:
        """The law of this air, from the one that was drawn."""
        return replace(law, wall_pull=WALL_PULL, wall_reach=WALL_REACH)


@dataclass
class StrongCornerBody(RoughBody):
    """Rough air in which everything of the corner is twice as strong."""

    def changed(self, law: LawConstants) -> LawConstants:
        """The law of this air, from the one that was drawn."""
        law = super().changed(law)
        return replace(
            law,
            trapped_lift=CORNER_TIMES * law.trapped_lift,
            trapped_tilt=CORNER_TIMES * law.trapped_tilt,
            trapped_pull=CORNER_TIMES * law.trapped_pull,
            ridge_lift=CORNER_TIMES * law.ridge_lift,
            ridge_pull=CORNER_TIMES * law.ridge_pull,
        )


AIRS: dict[str, type[Body]] = {
    "calm": Body,
    "rough": RoughBody,
    "strong corner": StrongCornerBody,
    "free": RoughBody,
}
"""By name. Free: turbulence and gusts, nothing of ground and wall."""
