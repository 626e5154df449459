"""Which flights there are, and which verdict each asks for. Fixed before any diagnosis was run on them.

A *round* is one full set of flights with its own seeds; rounds from ``HELD_OUT_ROUND`` on are shown to nobody who works
on the diagnosis and serve for the final figures only.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from zlib import crc32

import numpy as np

from .craft import QUAD, TANDEM, Craft
from .effects import CATALOGUE
from .plan import STANDARD, draw_plan
from .recorder import Logging
from .unlisted import UNLISTED
from .world import Job

HELD_OUT_ROUND = 100
FLIGHT_S = 170.0


@dataclass(frozen=True)
class Scenario:
    """One flight of a round."""

    name: str
    group: str  # null | single | pair | unlisted | bad
    craft: Craft = TANDEM
    effects: tuple[str, ...] = ()
    by_servo: bool = False
    blocks: tuple[str, ...] = STANDARD
    duration_s: float = FLIGHT_S
    log: Logging = field(default_factory=Logging)
    mass_factor: float = 1.0
    second: bool = False
    """A second vehicle's stream is in the same log."""

    def seed(self, round_number: int) -> int:
        """Seed of this flight in a round."""
        return crc32(f"{round_number}/{self.name}".encode()) % 1_000_000

    @property
    def model(self) -> str:
        """``table`` (train on it) or ``none``."""
        return "none" if self.craft is QUAD else "table"

    @property
    def verdict(self) -> str:
        """The right verdict."""
        if self.mass_factor != 1.0:
            return "explained"
        if self.group == "unlisted":
            return "unexplained"
        return "explained" if self.effects else "nothing_missing"

    @property
    def truth(self) -> tuple[str, ...]:
        """Names of the contract's catalogue that are undeclared in this flight."""
        if self.mass_factor != 1.0:
            return ("payload" if self.mass_factor < 1.0 else "thrust_scale",)
        return tuple(e for e in self.effects if e in CATALOGUE)

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that carry what is in no catalogue."""
        return tuple(c for e in self.effects if e in UNLISTED for c in UNLISTED[e].channels)

    def job(self, round_number: int) -> Job:
        """The flight itself: plan and parameters drawn from the seed."""
        seed = self.seed(round_number)
        rng = np.random.default_rng([seed, 3])
        kinds = [(CATALOGUE | UNLISTED)[name] for name in self.effects]
        first = tuple(
            dict.fromkeys(b for kind in kinds for b in kind.blocks if self.blocks == STANDARD)
        )
        avoid = {b for kind in kinds for b in kind.without}
        blocks = tuple(b for b in dict.fromkeys((*self.blocks, *first)) if b not in avoid)
        plan = draw_plan(rng, self.craft, blocks, self.duration_s, first=first)
        effects = {kind.name: kind.draw(rng, self.craft) for kind in kinds}
        return Job(seed, tuple(plan), effects, self.by_servo)

    @property
    def ceiling(self) -> bool:
        """Whether an up-looking rangefinder is declared."""
        return "ceiling" in self.effects

    @property
    def front(self) -> bool:
        """Whether a forward rangefinder is declared."""
        return "second_wall" in self.effects


PAIRS = (
    ("wind", "payload"),
    ("ceiling", "cg_offset"),
    ("range_offset", "vertical_inflow"),
    ("rotor_drag", "thrust_scale"),
    ("ground_effect", "imu_bias"),
    ("wall_effect", "fan_imbalance"),
)
ON_QUAD = (
    "thrust_scale",
    "payload",
    "wind",
    "rotor_drag",
    "cg_offset",
    "imu_bias",
    "ground_effect",
    "fan_imbalance",
)
NEEDS_OUTPUTS = ("battery_sag", "motor_lag")
"""Effects also flown on a vehicle whose thrust is declared by servo outputs, where they are at home."""

NEEDS_SINGLE_ROTORS = ("rotor_inertia",)
"""Effects that the spins of two rotors in one fan would cancel."""


def scenarios(round_number: int) -> list[Scenario]:
    """All flights of a round."""
    out = [Scenario(f"null_{k}", "null") for k in range(5)]
    out += [Scenario("null_servo", "null", by_servo=True), Scenario("null_quad", "null", QUAD)]
    for name in CATALOGUE:
        craft = QUAD if name in NEEDS_SINGLE_ROTORS else TANDEM
        out.append(Scenario(name, "single", craft, (name,)))
    out += [
        Scenario(f"{name}_servo", "single", effects=(name,), by_servo=True)
        for name in NEEDS_OUTPUTS
    ]
    start = round_number % len(ON_QUAD)
    for name in (ON_QUAD * 2)[start : start + 4]:
        out.append(Scenario(f"{name}_quad", "single", QUAD, (name,)))
    out += [Scenario("+".join(pair), "pair", effects=pair) for pair in PAIRS]
    out += [Scenario(name, "unlisted", effects=(name,)) for name in UNLISTED]
    return out + _bad()


def _bad() -> list[Scenario]:
    return [
        Scenario("bad_mass_low", "bad", mass_factor=0.7),
        Scenario("bad_mass_high", "bad", mass_factor=1.3),
        Scenario("bad_reboot", "bad", log=Logging(reboot_at_s=80.0)),
        Scenario("bad_reboot_payload", "bad", effects=("payload",), log=Logging(reboot_at_s=40.0)),
        Scenario("bad_clipped_imu", "bad", log=Logging(clip_m_s2=4.0 * 9.80665)),
        Scenario("bad_two_vehicles", "bad", second=True),
        Scenario("bad_two_vehicles_wind", "bad", effects=("wind",), second=True),
        Scenario("bad_no_rpm", "bad", log=Logging(send_rpm=False)),
        Scenario("bad_no_imu", "bad", log=Logging(send_imu=False)),
        Scenario("bad_20s", "bad", duration_s=20.0, blocks=("hover", "vertical")),
        Scenario(
            "bad_20s_wind", "bad", effects=("wind",), duration_s=20.0, blocks=("hover", "vertical")
        ),
        Scenario("bad_hover_only", "bad", blocks=("hover",)),
        Scenario("bad_hover_only_cg", "bad", effects=("cg_offset",), blocks=("hover",)),
        Scenario("bad_hover_only_drag", "bad", effects=("rotor_drag",), blocks=("hover",)),
    ]
