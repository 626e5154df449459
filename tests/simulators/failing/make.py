"""``python -m tests.simulators.failing.make OUT --seed N --each M``: flights of every kind, with their truth.

Every flight is written twice, with and without rotor speeds, each with a vehicle file. ``truth.json`` says what
happened: by name of the flight its kind, motors, time [s of the boot] and size.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np

from . import cases, craft, tlog, world

BOOT_S = 30.0
"""Time since boot at which a log begins."""


def make(folder: Path, seed: int, each: int, kinds: tuple[str, ...]) -> None:
    """So many flights of each kind, in turn of all frames."""
    folder.mkdir(parents=True, exist_ok=True)
    truth = {}
    rng = np.random.default_rng([seed, 77])
    for offset, frame in enumerate(craft.FRAMES):
        names = []
        crafts = []
        flights = []
        for row, kind in enumerate(kinds):
            for number in range(each):
                if (row + number + seed) % len(craft.FRAMES) != offset:
                    continue
                crafts.append(craft.draw(frame, rng))
                flights.append(cases.draw(kind, crafts[-1].count, rng))
                names.append(f"{kind}_{seed}_{number}")
        if not names:
            continue
        tape = world.fly(crafts, flights, rng)
        for i, name in enumerate(names):
            servo = int(rng.choice([1, 2, 5]))
            imu = int(rng.choice([1, 2]))
            rates = tlog.Rates(imu=imu, servo=servo)
            for speeds in (False, True):
                own = f"{name}_{'speeds' if speeds else 'outputs'}"
                tlog.write(
                    folder / f"{own}.tlog",
                    crafts[i],
                    flights[i],
                    tape,
                    i,
                    seed + i,
                    speeds=speeds,
                    rates=rates,
                )
                text = craft.vehicle_toml(crafts[i], rng, speeds=speeds)
                (folder / f"{own}.toml").write_text(text, encoding="utf-8")
                happened = asdict(flights[i]) | {"frame": frame, "fails": flights[i].fails}
                truth[own] = happened | {"since_s": flights[i].since_s + BOOT_S}
    (folder / "truth.json").write_text(json.dumps(truth, indent=1), encoding="utf-8")


def main() -> None:
    """As the docstring says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--each", type=int, default=3)
    parser.add_argument("--kind", nargs="*", default=[*cases.FAILURES, *cases.OTHERS])
    a = parser.parse_args()
    make(a.folder, a.seed, a.each, tuple(a.kind))


if __name__ == "__main__":
    main()
