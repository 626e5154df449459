"""How far a sudden wind moves a vehicle in free air: ``python tests/benchmarks faults.gust_drift``.

Simulated, offsets off. Beside it the acceleration by which the air pushes: momentum drag of the rotors, and the vanes
that hold its moment.
"""

from __future__ import annotations

from collections.abc import Iterator

import command_line
from flight_case import Case, CasePilot, surroundings
from lockstep_faults import FaultyLockstep
from simulated import simulated

import models
from companion.config import PipelineConfig
from companion.vehicles import QUAD, TANDEM
from faults.campaign import STACKS
from models.vehicle import Vehicle, load_vehicle

WINDS_M_S = (1.5, 2.5, 4.0)
HEIGHT_M = 2.5
SECONDS = 4.0


def drift(vehicle: Vehicle, stack: str, wind_m_s: float) -> tuple[float, float]:
    """Furthest way along a wind from the left [m], and the mean push over the first second [m/s^2]."""
    own = PipelineConfig(vehicle=vehicle, model=models.load(), offsets=False)
    seen: list[tuple[float, float]] = []

    def script(pilot: CasePilot) -> Iterator[float]:
        body = pilot.flight.body
        yield from pilot.take_off(HEIGHT_M)
        yield from pilot.hand_over()
        pilot.go(0.0, 0.0, HEIGHT_M)
        yield 5.0
        start = body.position[1]
        body.wind = (0.0, wind_m_s, 0.0)
        for _ in range(round(SECONDS / 0.02)):
            yield 0.02
            push = body.causes.drag[1] + body.causes.vanes[1]
            seen.append((body.position[1] - start, push / own.vehicle.mass_kg))

    case = Case("gust", "", script, px4=stack == "px4")
    flight = simulated(own.vehicle, surroundings(case, own.vehicle), 1, px4=case.px4)
    FaultyLockstep(flight, lambda world: CasePilot(world, script)).fly(own, None)
    first = [push for _, push in seen[:50]]
    return max(way for way, _ in seen), sum(first) / len(first)


def main() -> None:
    """Fly and print."""
    command_line.parser(__doc__).parse_args()
    print("simulated, free air\nvehicle  stack      wind m/s  push m/s²  moved m  moved/push s²")
    for path in (QUAD, TANDEM):
        for stack in STACKS:
            for wind in WINDS_M_S:
                way, push = drift(load_vehicle(path), stack, wind)
                print(
                    f"{path.stem:8} {stack:10} {wind:8.1f}  {push:9.2f}  {way:7.2f}  {way / push:13.2f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
