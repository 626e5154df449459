"""Flights on a real ArduCopter or PX4 (docs/firmware.md): how far the vehicle moves when something happens at a wall.

``ARDUCOPTER_BIN=… python tests/benchmarks safety.firmware_flights FLIGHT… [--first 1] [--flights 10] [--json FILE]
[--record DIR] [--result FILE]``. Real firmware, simulated air (tests/firmware/rough_air.py). The seed draws air and
sensors; time is the firmware's, so no two flights are the same. With ``--json`` flights that are in the file already
are not flown again. Distances are the truth of the physics, NED, and changes only: an error of the GPS does not count.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import signal
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from result_file import _commit, add_option, figure, write_result

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "firmware"))
from rig import ARDUCOPTER, GUIDED, OFFBOARD, PX4, Moment, Rig

HEIGHT_M = 1.5
GAP_M = 0.3
"""Lip to wall where the approach ends."""
WALL_NORTH_M = 1.6 - GAP_M
"""The scenario's wall is 1.6 m from the lip at the start."""
FREE_NORTH_M = -1.2
SPEED_M_S, TARGETS_HZ = 0.3, 25.0
"""Of the approach, as in the recordings of others: places that move, with their velocity, and stop at once."""
STALL_S = 3.0
AFTER_S, SETTLED_S = 8.0, 3.0
"""After something has happened the vehicle is watched so long; at the end of a ramp it rests in the last part of it."""
LEFT_S = 16.0
"""The same after the companion is gone: the trim of PX4's position control takes several seconds."""
SLOW_LOOP = {
    "ATC_ANG_RLL_P": 2.25,
    "ATC_ANG_PIT_P": 2.25,
    "ATC_INPUT_TC": 0.3,
    "MC_ROLL_P": 3.0,
    "MC_PITCH_P": 3.0,
}
SLOW_POSITION_HZ = 10.0
ARRIVED_M = 0.03
STEADY_RATIO = 0.9985
"""Autopilot's seconds in a second of the clock, below which a flight does not count: the machine was too busy. In 100 s
that is 0.15 s, which the companion takes for late telemetry."""
STOOD = re.compile(r"stood still for ([\d.]+) s")
NAMES = {ARDUCOPTER: "ArduCopter", PX4: "PX4"}
NOT_KNOWN = "clock lost time: taken for lateness"
GOALS_M = {
    "ramp in free air: overshoot": 0.03, "ramp to the wall: overshoot": 0.03,
    "ramp in free air: trailing, seconds": 0.3, "ramp to the wall: trailing, seconds": 0.3,
    "slow loop, ramp in free air: overshoot": 0.06, "slow loop, ramp to the wall: overshoot": 0.06,
    "stands still for 3 s at the wall: towards it": 0.05, "Ctrl-C at the wall: towards it": 0.05,
    "kill -9 at the wall: towards it": 0.05, "ground range froze: height wrong 3 s after": 0.03,
    "contact s": 0.0, NOT_KNOWN: 0.0,
}  # fmt: skip
"""Issue goals; of the height, what a beam of 1 cm and 8 mm of noise tells within a second."""


class Pilot:
    """Flies a rig by targets, and remembers when what happened, in the time of the truth."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.at = (0.0, HEIGHT_M)
        self.marks: dict[str, float] = {}
        self.found: dict[str, float] = {}

    def mark(self, name: str) -> None:
        self.marks[name] = self.rig.true_time_s

    def stay(self, seconds: float) -> None:
        self.rig.go(self.at[0], 0.0, self.at[1], (0.0, 0.0, 0.0))
        self.rig.sleep(seconds)

    def ramp(self, north: float, height: float, name: str = "") -> None:
        """At ``SPEED_M_S`` and, at the end, not at all."""
        (n0, h0), start = self.at, time.monotonic()
        way = ((north - n0) ** 2 + (height - h0) ** 2) ** 0.5
        speed = (SPEED_M_S * (north - n0) / way, 0.0, SPEED_M_S * (height - h0) / way)
        while (t := time.monotonic() - start) * SPEED_M_S < way:
            self.rig.go(n0 + speed[0] * t, 0.0, h0 + speed[2] * t, speed)
            time.sleep(1.0 / TARGETS_HZ)
        self.at = (north, height)
        if name:
            self.mark(name)
        self.stay(AFTER_S)

    def again(self) -> None:
        """Whatever was flown meanwhile: back in command at the place."""
        wanted = OFFBOARD if self.rig.px4 else GUIDED

        def entered() -> bool:
            if self.rig.in_mode != wanted[0]:
                self.rig.mode(wanted)
                time.sleep(0.3)
            return self.rig.in_mode == wanted[0]

        self.rig.until(entered, 20.0, "OFFBOARD or GUIDED")
        self.stay(AFTER_S)


def wall(p: Pilot) -> None:
    """Ramps, then what may happen to the companion at a wall."""
    rig = p.rig
    p.mark("attached in the air")
    rig.engage()
    p.ramp(FREE_NORTH_M, HEIGHT_M, "ramp in free air")
    p.ramp(WALL_NORTH_M, HEIGHT_M, "ramp to the wall")
    p.mark("stands still for 3 s at the wall")
    rig.signal_companion(signal.SIGSTOP)
    rig.sleep(STALL_S)
    rig.signal_companion(signal.SIGCONT)
    rig.sleep(AFTER_S)
    p.again()
    p.mark("Ctrl-C at the wall")
    rig.signal_companion(signal.SIGINT)
    rig.sleep(LEFT_S)
    rig.engage()
    p.again()
    p.mark("kill -9 at the wall")
    rig.signal_companion(signal.SIGKILL)
    rig.sleep(LEFT_S)


def slow(p: Pilot) -> None:
    """Ramps with a slow attitude loop and late positions."""
    p.rig.engage()
    p.ramp(FREE_NORTH_M, HEIGHT_M, "slow loop, ramp in free air")
    p.ramp(WALL_NORTH_M, HEIGHT_M, "slow loop, ramp to the wall")


def sensors(p: Pilot) -> None:
    """A ground range that freezes during a climb and a descent; the boot clock loses time."""
    rig = p.rig
    rig.engage()
    p.stay(4.0)
    p.mark("ground range froze")
    rig.freeze_ground_range()
    p.ramp(0.0, HEIGHT_M + 0.5)
    p.ramp(0.0, HEIGHT_M)
    p.mark("ground range returns")
    rig.freeze_ground_range()
    rig.sleep(AFTER_S)
    p.mark("the boot clock lost time")
    heard = len(rig.texts)
    rig.stand_still(1.0)
    rig.sleep(10.0)
    said = rig.texts[heard:]
    p.found[NOT_KNOWN] = float(not any("clock was set back" in text for text in said))


FLIGHTS: dict[str, tuple[Callable[[Pilot], None], dict[str, float], float]] = {
    "wall": (wall, {}, 0.0), "slow": (slow, SLOW_LOOP, SLOW_POSITION_HZ), "sensors": (sensors, {}, 0.0),
}  # fmt: skip


def between(truth: Sequence[Moment], start: float, seconds: float) -> list[Moment]:
    return [m for m in truth if start <= m.time_s < start + seconds]


def measure(truth: Sequence[Moment], marks: dict[str, float]) -> dict[str, float]:
    """Name of the figure, and its size in m or s."""
    out: dict[str, float] = {}
    for name, t in marks.items():
        if "ramp" in name:
            rest = statistics.median(
                m.north for m in between(truth, t + AFTER_S - SETTLED_S, SETTLED_S)
            )
            sign = -1.0 if "free" in name else 1.0
            seen = [
                (m.time_s, sign * (m.north - rest)) for m in between(truth, t - 1.0, AFTER_S + 1.0)
            ]
            out[f"{name}: overshoot"] = max(x for _, x in seen)
            behind = [-x / SPEED_M_S - (t - when) for when, x in seen if when < t]
            out[f"{name}: trailing, seconds"] = statistics.median(behind)
            out[f"{name}: seconds to {100 * ARRIVED_M:.0f} cm"] = max(
                [x for x, off in seen if abs(off) > ARRIVED_M], default=t
            ) - t  # fmt: skip
        elif "at the wall" in name:
            seconds = AFTER_S + STALL_S if "still" in name else LEFT_S
            seen_ = between(truth, t, seconds)
            a = seen_[0]
            out[f"{name}: towards it"] = max(m.north for m in seen_) - a.north
            out[f"{name}: along it"] = max(abs(m.east - a.east) for m in seen_)
            out[f"{name}: down"] = a.height - min(m.height for m in seen_)
    if (t := marks.get("attached in the air")) is not None:
        seen_ = between(truth, t, 10.0)
        out["attached in the air: moved"] = max(
            ((m.north - seen_[0].north) ** 2 + (m.east - seen_[0].east) ** 2) ** 0.5 for m in seen_
        )
    if (t := marks.get("ground range returns")) is not None:
        before = statistics.median(
            m.height for m in between(truth, marks["ground range froze"] - 3.0, 3.0)
        )
        after = statistics.median(m.height for m in between(truth, t + 2.5, 1.0))
        out["ground range froze: height wrong 3 s after"] = abs(after - before)
        worst = max(abs(m.height - before) for m in between(truth, t, AFTER_S))
        out["ground range froze: height wrong at most after"] = worst
    out["contact s"] = 0.02 * sum(m.contact for m in truth if m.time_s > min(marks.values()))
    return out


def fly(firmware: str, name: str, seed: int, folder: Path) -> dict[str, Any]:
    """One flight: its figures, what was said, and how well the machine kept time."""
    script, parameters, position_hz = FLIGHTS[name]
    if firmware == ARDUCOPTER:
        parameters = {k: v for k, v in parameters.items() if not k.startswith("MC_")}
    else:
        parameters = {k: v for k, v in parameters.items() if k.startswith("MC_")}
    out: dict[str, Any] = {
        "firmware": NAMES[firmware],
        "flight": name,
        "seed": seed,
        "commit": _commit(),
    }
    with Rig(
        firmware,
        os.environ[firmware],
        folder,
        parameters,
        seed=seed,
        position_hz=position_hz,
        air="rough",
    ) as rig:
        pilot = Pilot(rig)
        try:
            rig.take_off()
            start = time.monotonic(), rig.true_time_s
            script(pilot)
            spent, flown = time.monotonic() - start[0], rig.true_time_s - start[1]
        except (AssertionError, RuntimeError) as error:
            return out | {"failed": str(error), "marks": pilot.marks, "texts": rig.texts}
        truth = rig.truth()
    return out | {
        "figures": measure(truth, pilot.marks) | pilot.found, "clock": round(flown / spent, 4),
        "load": os.getloadavg()[0], "marks": pilot.marks, "texts": rig.texts,
    }  # fmt: skip


def counts(flight: dict[str, Any]) -> bool:
    """Whether the machine let autopilot and companion run: a companion that was starved says that it stood still."""
    least = STEADY_RATIO if flight["flight"] != "sensors" else 0.98  # it stops the clock itself
    stalls = [float(found[1]) for text in flight["texts"] if (found := STOOD.search(text))]
    starved = [s for s in stalls if flight["flight"] != "wall" or abs(s - STALL_S) > 0.5]
    return flight.get("clock", 0.0) >= least and not starved


def table(flights: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Median and worst of each figure of the flights that count, and the worst of all that were flown."""
    groups: dict[tuple[str, str], list[tuple[float, bool]]] = {}
    for f in flights:
        for what, size in f.get("figures", {}).items():
            groups.setdefault((f["firmware"], what), []).append((size, counts(f)))
    rows = []
    for (firmware, what), flown in groups.items():
        sizes, everything = (
            [size for size, good in flown if good] or [math.nan],
            [size for size, _ in flown],
        )
        unit = "s" if "seconds" in what or what == "contact s" else "" if what == NOT_KNOWN else "m"
        digits = 2 if unit == "s" else 3
        detail = f"median of {len(sizes)}, worst {max(sizes):.{digits}f}"
        detail += f"; worst of all {len(flown)} flown {max(everything):.{digits}f}"
        goal = GOALS_M.get(what)
        met = None if goal is None else max(sizes) <= goal
        value = f"{statistics.median(sizes):.{digits}f} {unit}".strip()
        wanted = "" if goal is None else f"{goal:g} {unit}".strip()
        rows.append(figure(f"{firmware}, {what}", value, detail, wanted, met))
    return rows


def main() -> int:
    """Fly, and print median and worst."""
    p = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    p.add_argument("flight", nargs="*", help=f"which of {', '.join(FLIGHTS)} (default: all)")
    p.add_argument("--first", type=int, default=1, help="first seed")
    p.add_argument("--flights", type=int, default=10, help="flights of each kind")
    p.add_argument(
        "--json", type=Path, metavar="FILE", help="every flight; those in it are not flown again"
    )
    p.add_argument(
        "--record", type=Path, metavar="DIR", help="keep recordings, truth and words here"
    )
    add_option(p)
    a = p.parse_args()
    if unknown := set(a.flight) - set(FLIGHTS):
        p.error(f"no such flight: {', '.join(unknown)}")
    firmwares = [f for f in (ARDUCOPTER, PX4) if os.environ.get(f)]
    if not firmwares:
        p.error("neither ARDUCOPTER_BIN nor PX4_BIN names a binary: docs/firmware.md")
    flights = json.loads(a.json.read_text(encoding="utf-8")) if a.json and a.json.exists() else []
    known = {(f["firmware"], f["flight"], f["seed"]) for f in flights}
    for seed in range(a.first, a.first + a.flights):
        for name in a.flight or FLIGHTS:
            for firmware in firmwares:
                if (NAMES[firmware], name, seed) in known:
                    continue
                with tempfile.TemporaryDirectory() as scratch:
                    folder = (a.record or Path(scratch)) / f"{NAMES[firmware]}_{name}_{seed}"
                    folder.mkdir(parents=True, exist_ok=True)
                    found = fly(firmware, name, seed, folder)
                flights.append(found)
                print(
                    json.dumps({k: v for k, v in found.items() if k not in ("texts", "marks")}),
                    flush=True,
                )
                if a.json:
                    a.json.write_text(json.dumps(flights, indent=1) + "\n", encoding="utf-8")
    rows = table(flights)
    for row in rows:
        print(f"{row['what']:75} {row['value']:>9}  {row['detail']:60} {row.get('goal', '')}")
    ended = sum("failed" in f for f in flights)
    print(
        f"{sum(map(counts, flights))} of {len(flights)} flights count; {ended} did not fly to the end"
    )
    seeds = f"{a.first} to {a.first + a.flights - 1}"
    stated = [r for r in rows if "goal" in r or "attached" in r["what"]]
    write_result(a, stated, seeds=seeds, simulated=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
