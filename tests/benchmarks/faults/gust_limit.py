"""What the vehicle can do against a gust at best: ``python tests/benchmarks faults.gust_limit``.

The full tilt away from the wall is commanded in the very instant of the gust, past link and sensors. How much nearer
does the vehicle come before it stops? Simulated; of the flight program it holds the hover before the gust alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import command_line

from companion.sim.autopilot import AttitudeDemand
from faults.campaign import GAP_M, STACKS, Bench, Fault, fly
from faults.catalog import calm, wind

TILTS_DEG = (15.0, 24.0, 30.0)
SEEDS = (1, 2, 3)


@dataclass
class BestAnswer:
    """Leans away at once, and watches."""

    tilt_rad: float
    start_m: float = field(default=0.0, init=False)
    nearer_m: float = field(default=0.0, init=False)
    turned: bool = field(default=False, init=False)

    def begin(self, b: Bench) -> None:
        """The gust, and the answer."""
        self.start_m = b.flight.body.position[1]
        wind(b)
        b.world.stall(1.0)
        autopilot = b.flight.autopilot
        thrust = autopilot.attitude.thrust
        autopilot.fly_attitude(AttitudeDemand(roll=-self.tilt_rad, thrust=thrust, time_s=b.now_s))

    def watch(self, b: Bench) -> None:
        """Until it flies away from the wall."""
        self.turned = self.turned or (self.nearer_m > 0.05 and b.flight.body.velocity[1] < 0.0)
        if not self.turned:
            self.nearer_m = max(self.nearer_m, b.flight.body.position[1] - self.start_m)


def main() -> None:
    """Fly and print."""
    command_line.parser(__doc__).parse_args()
    print(
        f"simulated; the wall is {GAP_M} m away\nstack      tilt away   comes nearer by, m (seeds {SEEDS})"
    )
    for stack in STACKS:
        for tilt in TILTS_DEG:
            near = []
            for seed in SEEDS:
                answer = BestAnswer(math.radians(tilt))
                fly(
                    Fault("gust", "", answer.begin, end=calm, each=answer.watch, seconds=1.0),
                    stack,
                    seed,
                )
                near.append(answer.nearer_m)
            print(f"{stack:10} {tilt:5.0f} deg   " + "  ".join(f"{m:.2f}" for m in near))


if __name__ == "__main__":
    main()
