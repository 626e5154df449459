"""Many flights on a real firmware at a time: what offsets remove, and one wrong sensor at a wall.

``ARDUCOPTER_BIN=… python tests/benchmarks safety.firmware_campaign {air,wrong} [--first 1]
[--seeds 2] [--jobs 1] [--only TEXT] [--json FILE] [--record DIR] [--result FILE]``. With ``--px4``
it is PX4, and ``PX4_BIN``. Real firmware, simulated air (tests/firmware/rough_air.py), each flight in
a network of its own. A flight takes two to four minutes and keeps two cores busy: no more ``--jobs``
than half the cores, of PX4 one. With ``--json`` flights that are in the file already are not flown
again.

*air*: twice free, low, wall, corner and back; the second time counts. *amended* flies with what
``replay diagnose`` made of the flight without offsets in the same air. *wrong*: to the wall, then
something goes wrong for ten seconds. Distances are the truth of the physics.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from adaptation.adapt_recordings import decisions
from result_file import add_option, figure, write_result
from tqdm import tqdm

from safety.firmware_flights import (
    FREE_NORTH_M,
    HEIGHT_M,
    SLOW_LOOP,
    STEADY_RATIO,
    WALL_NORTH_M,
    Pilot,
)

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "firmware"))
from own_network import in_own_network, raise_loopback
from rig import ARDUCOPTER, PX4, Rig
from wrong_sensors import NOTHING_WRONG, Range, Wrong

from companion.adapt_options import Adapt
from companion.config import PipelineConfig
from companion.sim.scenario import lip_reach
from companion.vehicles import QUAD
from models.choice import NONE, choose
from models.common.frames import GRAVITY, Array
from models.vehicle import Vehicle, load_vehicle

BENCHMARKS = Path(__file__).resolve().parents[1]
LOW_M = 0.2
"""Height of the autopilot: its feet are 0.2 m above the ground."""
APPROACHES = 2
BEFORE_S, WRONG_S = 4.0, 10.0
SETTLED_S = 5.0
PHASES = ("ground", "wall", "corner")
DEFAULT, OFF, AMENDED = "default", "off", "amended"
FLIGHT_TIMEOUT_S = 900.0
GOALS_PERCENT = {"ground": 0.0, "wall": 75.0, "corner": 60.0}
WORST_PERCENT = -5.0
TURNED_DEG = -30.0
"""Heading at which the wall is to the right of the beam."""
LEAST_PUSH_DEG = 0.1
"""A smaller push tilts the vehicle by less than the estimator's own error."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One kind of flight."""

    air: str = "rough"
    companion: str = DEFAULT
    wrong: Wrong | None = None
    parameters: dict[str, float] | None = None
    position_hz: float = 0.0
    mass_times: float = 1.0
    set_in_flight: tuple[str, float] | None = None
    heading_deg: float | None = None
    """The wall is in the north, where the beam looks at heading 0."""


def _air_cases() -> dict[str, Case]:
    """Free air and no offsets to compare with; the default and an amended model in either air."""
    cases = {"free": Case(air="free", companion=OFF)}
    for air in ("rough", "strong corner"):
        for companion in (OFF, DEFAULT, AMENDED):
            cases[f"{air}, {companion}"] = Case(air=air, companion=companion)
    for companion in (OFF, DEFAULT):
        cases[f"turned wall, {companion}"] = Case(companion=companion, heading_deg=TURNED_DEG)
    return cases


AIR_CASES = _air_cases()
WRONG_CASES = {
    "nothing": Case(wrong=NOTHING_WRONG),
    "position steps 0.5 m from the wall": Case(wrong=Wrong(position_off_m=(-0.5, 0.0, 0.0))),
    "position steps 0.5 m to the wall": Case(wrong=Wrong(position_off_m=(0.5, 0.0, 0.0))),
    "position steps 0.5 m along the wall": Case(wrong=Wrong(position_off_m=(0.0, 0.5, 0.0))),
    "position drifts from the wall": Case(wrong=Wrong(position_drift_m_s=(-0.1, 0.0, 0.0))),
    "position drifts to the wall": Case(wrong=Wrong(position_drift_m_s=(0.1, 0.0, 0.0))),
    "position freezes": Case(wrong=Wrong(position_frozen=True)),
    "position turns by 25 degrees": Case(wrong=Wrong(position_turned_deg=25.0)),
    "at a turned wall, nothing": Case(wrong=NOTHING_WRONG, heading_deg=TURNED_DEG),
    "at a turned wall, position steps 0.5 m from it": Case(
        wrong=Wrong(position_off_m=(-0.5, 0.0, 0.0)), heading_deg=TURNED_DEG
    ),
    "at a turned wall, position drifts from it": Case(
        wrong=Wrong(position_drift_m_s=(-0.1, 0.0, 0.0)), heading_deg=TURNED_DEG
    ),
    "wall range 0.4 m more": Case(wrong=Wrong(wall_range_off_m=0.4)),
    "wall range 0.4 m less": Case(wrong=Wrong(wall_range_off_m=-0.4)),
    "wall range drifts to more": Case(wrong=Wrong(wall_range_drift_m_s=0.1)),
    "wall range drifts to less": Case(wrong=Wrong(wall_range_drift_m_s=-0.1)),
    "wall range freezes": Case(wrong=Wrong(wall_range=Range.FROZEN)),
    "wall range lost": Case(wrong=Wrong(wall_range=Range.LOST)),
    "wall range in the sun": Case(wrong=Wrong(wall_range=Range.SUN)),
    "ground range freezes": Case(wrong=Wrong(ground_range=Range.FROZEN)),
    "compass off by 25 degrees": Case(
        wrong=NOTHING_WRONG, set_in_flight=("COMPASS_DEC", math.radians(25.0))
    ),
    "slow attitude loop": Case(wrong=NOTHING_WRONG, parameters=SLOW_LOOP),
    "positions at 10 Hz": Case(wrong=NOTHING_WRONG, position_hz=10.0),
    "a third heavier than the file": Case(wrong=NOTHING_WRONG, mass_times=1.3),
    "gust of 3 m/s to the wall": Case(wrong=Wrong(gust_m_s=(3.0, 0.0, 0.0))),
}
CASES = {"air": AIR_CASES, "wrong": WRONG_CASES}


def companion_options(case: Case, model: Path | None) -> tuple[str, ...]:
    """Of the command line."""
    if case.companion == OFF:
        return ("--no-offsets",)
    if case.companion == AMENDED:
        assert model is not None
        return ("--model", str(model))
    return ()


def fly_air(p: Pilot) -> None:
    """Free, low, wall, corner and back, so many times."""
    p.rig.engage()
    p.ramp(FREE_NORTH_M, HEIGHT_M)
    for k in range(APPROACHES):
        last = k == APPROACHES - 1
        for north, height, phase in (
            (FREE_NORTH_M, LOW_M, "ground"),
            (FREE_NORTH_M, HEIGHT_M, ""),
            (WALL_NORTH_M, HEIGHT_M, "wall"),
            (WALL_NORTH_M, LOW_M, "corner"),
            (WALL_NORTH_M, HEIGHT_M, ""),
            (FREE_NORTH_M, HEIGHT_M, ""),
        ):
            p.ramp(north, height, phase if last else "")


def fly_wrong(p: Pilot, case: Case) -> None:
    """To the wall; then something is wrong, and right again."""
    assert case.wrong is not None
    p.rig.engage()
    p.ramp(FREE_NORTH_M, HEIGHT_M)
    p.ramp(WALL_NORTH_M, HEIGHT_M, "at the wall")
    p.stay(BEFORE_S)
    p.mark("wrong")
    if case.set_in_flight is not None:
        p.rig.set_parameter(*case.set_in_flight)
    p.rig.go_wrong(case.wrong)
    p.rig.sleep(WRONG_S)
    p.mark("right again")


def truth_table(path: Path) -> Any:
    """The truth of one flight, by column."""
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.reader(file)
        names = next(reader)
        rows = [row for row in reader if len(row) == len(names)]
    columns = np.array(rows, dtype=float).T
    return dict(zip(names, columns, strict=True))


def sent_pitch(
    record: Path, case: Case, model: Path | None, file: Path = QUAD
) -> tuple[Array, Array]:
    """Boot times [s] and tilt to the south of the offset [rad] of the recording, decided again."""
    vehicle = load_vehicle(file)
    name = str(model) if case.companion == AMENDED else NONE
    config = PipelineConfig(
        vehicle=vehicle,
        model=choose(vehicle, name).model,
        offsets=case.companion != OFF,
        adapt=Adapt.FULL,
    )
    heading = math.radians(case.heading_deg or 0.0)
    times = []
    pitch = []
    for decision in decisions(record, config):
        times.append(decision.t_s)
        offset = decision.offset
        pitch.append(offset.pitch * math.cos(heading) + offset.roll * math.sin(heading))
    return np.array(times), np.array(pitch)


def air_figures(
    truth: dict[str, Array], pilot: Pilot, sent: tuple[Array, Array], weight: float
) -> dict[str, float]:
    """By phase: mean square errors where the vehicle has settled [m^2], tilt that was needed and sent.

    ``weight`` [N]: of the vehicle.
    """
    believed = np.array(pilot.rig.estimates)
    goals = {"ground": (FREE_NORTH_M, LOW_M), "wall": (WALL_NORTH_M, HEIGHT_M)}
    goals["corner"] = (WALL_NORTH_M, LOW_M)
    found: dict[str, float] = {}
    for phase in PHASES:
        end = pilot.marks[phase] + 8.0
        t = truth["time_s"]
        now = (t >= end - SETTLED_S) & (t < end)
        when = t[now]
        # The estimator's own error is none of ours.
        off_n = np.mean(truth["n"][now] - np.interp(when, believed[:, 0], believed[:, 1]))
        off_d = np.mean(truth["d"][now] - np.interp(when, believed[:, 0], believed[:, 3]))
        north, height = goals[phase]
        error_n = truth["n"][now] - off_n - north
        error_d = truth["d"][now] - off_d + height
        found[f"{phase}: sideways m2"] = float(np.mean(error_n**2))
        found[f"{phase}: height m2"] = float(np.mean(error_d**2))
        needed = truth["push_n"][now] / weight
        given = np.interp(when, sent[0], sent[1])
        found[f"{phase}: tilt needed deg"] = math.degrees(float(np.mean(needed)))
        found[f"{phase}: tilt sent deg"] = math.degrees(float(np.mean(given)))
        found[f"{phase}: push m2"] = float(np.mean(needed**2))
        found[f"{phase}: push left m2"] = float(np.mean((needed - given) ** 2))
    return found


def lip_nearer_m(vehicle: Vehicle, heading_deg: float | None) -> float:
    """How much further the foremost lip stands out to the north than at heading 0."""
    azimuth = -math.radians(heading_deg or 0.0)
    return lip_reach(vehicle, azimuth) - lip_reach(vehicle, 0.0)


def wrong_figures(
    truth: dict[str, Array], marks: dict[str, float], nearer_m: float
) -> dict[str, float]:
    """How far the vehicle went, and how long it touched something; ``nearer_m``: of the lip by the heading."""
    t = truth["time_s"]
    before = (t > marks["wrong"] - 2.0) & (t <= marks["wrong"])
    during = (t > marks["wrong"]) & (t <= marks["right again"])
    engaged = (t > marks["at the wall"] - 10.0) & (t <= marks["right again"])
    start = [float(np.median(truth[c][before])) for c in ("n", "e", "d")]
    north, east, down = (truth[c][during] - s for c, s in zip(("n", "e", "d"), start, strict=True))
    lip_m = WALL_NORTH_M + 0.3 - truth["n"][during] - nearer_m
    return {
        "towards the wall m": float(np.max(north)),
        "off m": float(np.max(np.sqrt(north**2 + east**2 + down**2))),
        "least lip to wall m": float(np.min(lip_m)),
        "contact s": 0.02 * float(np.sum(truth["contact"][during])),
        "contact before s": 0.02 * float(np.sum(truth["contact"][engaged & ~during])),
        "tilt deg": math.degrees(
            float(np.max(np.hypot(truth["roll"][during], truth["pitch"][during])))
        ),
    }


def fly(
    *,
    kind: str,
    name: str,
    seed: int,
    folder: Path,
    model: Path | None,
    vehicle: Path,
    px4: bool,
) -> dict[str, Any]:
    """One flight in this network: its figures and what was said."""
    case = CASES[kind][name]
    firmware = PX4 if px4 else ARDUCOPTER
    parameters = {}
    for parameter, value in (case.parameters or {}).items():
        if parameter.startswith("MC_") == px4:
            parameters[parameter] = value
    out: dict[str, Any] = {"kind": kind, "case": name, "seed": seed}
    with Rig(
        firmware,
        os.environ[firmware],
        folder,
        parameters,
        seed=seed,
        position_hz=case.position_hz,
        air=case.air,
        mass_times=case.mass_times,
        options=companion_options(case, model),
        vehicle=vehicle,
    ) as rig:
        pilot = Pilot(rig)
        try:
            rig.take_off()
            rig.heading_deg = case.heading_deg
            start = time.monotonic(), rig.true_time_s
            if kind == "air":
                fly_air(pilot)
            else:
                fly_wrong(pilot, case)
            spent = time.monotonic() - start[0]
            out["clock"] = round((rig.true_time_s - start[1]) / spent, 4)
        except (AssertionError, RuntimeError) as error:
            return out | {"failed": str(error), "marks": pilot.marks, "texts": rig.texts}
    truth = truth_table(folder / "truth.csv")
    if kind == "air":
        sent = sent_pitch(folder / "flight.tlog", case, model, vehicle)
        weight = load_vehicle(vehicle).mass_kg * GRAVITY
        figures = air_figures(truth, pilot, sent, weight)
    else:
        nearer_m = lip_nearer_m(load_vehicle(vehicle), case.heading_deg)
        figures = wrong_figures(truth, pilot.marks, nearer_m)
    return out | {"figures": figures, "marks": pilot.marks, "texts": rig.texts}


def folder_of(records: Path, kind: str, name: str, seed: int) -> Path:
    """Where a flight keeps its recording."""
    words = name.replace(",", "").replace(" ", "_")
    return records / f"{kind}_{words}_{seed}"


def learned_model(records: Path, air: str, seed: int, vehicle: Path) -> Path | None:
    """What ``replay diagnose`` makes of the flight without offsets; None where it makes nothing."""
    folder = folder_of(records, "air", f"{air}, {OFF}", seed)
    model = folder / "model"
    if not model.exists():
        command = [sys.executable, "-m", "replay", "diagnose", str(folder / "flight.tlog")]
        command += ["--vehicle", str(vehicle), "--model", NONE, "--save-model", str(model)]
        command += ["--json", str(folder / "answer.json"), "--quiet"]
        subprocess.run(command, capture_output=True, timeout=FLIGHT_TIMEOUT_S, check=False)
    return model if model.exists() else None


def fly_apart(
    records: Path, kind: str, name: str, seed: int, *, vehicle: Path, px4: bool
) -> dict[str, Any]:
    """One flight in a process and a network of its own."""
    flight = {"kind": kind, "case": name, "seed": seed, "texts": []}
    folder = folder_of(records, kind, name, seed)
    folder.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, str(BENCHMARKS), "safety.firmware_campaign", "one"]
    command += ["--only", json.dumps([kind, name, seed])]
    command += ["--record", str(folder), "--vehicle", str(vehicle)]
    if px4:
        command.append("--px4")
    case = CASES[kind][name]
    if case.companion == AMENDED:
        model = learned_model(records, case.air, seed, vehicle)
        if model is None:
            return flight | {"failed": "no model came of the flight without offsets"}
        command += ["--model", str(model)]
    told = subprocess.run(
        in_own_network(command),
        capture_output=True,
        text=True,
        timeout=FLIGHT_TIMEOUT_S,
        check=False,
    )
    if told.returncode:
        return flight | {"failed": told.stderr.strip()[-300:]}
    answer: dict[str, Any] = json.loads(told.stdout.splitlines()[-1])
    return answer


def counts(flight: dict[str, Any]) -> bool:
    """Whether it flew to the end, and the machine kept time."""
    return "figures" in flight and flight["clock"] >= STEADY_RATIO


def push_row(name: str, phase: str, flown: Sequence[dict[str, float]]) -> dict[str, Any]:
    """What of the sideways push is removed; where there is none, the tilt that is sent nevertheless."""
    most = max(f[f"{phase}: push m2"] for f in flown)
    if most < math.radians(LEAST_PUSH_DEG) ** 2:
        sent = max(abs(f[f"{phase}: tilt sent deg"]) for f in flown)
        return figure(f"{name}: tilt sent where none is needed", f"{sent:.2f} deg", "largest")
    removed = []
    for f in flown:
        left = f[f"{phase}: push left m2"] / f[f"{phase}: push m2"]
        removed.append(100.0 * (1.0 - left))
    middle = statistics.median(removed)
    least = min(removed)
    goal = GOALS_PERCENT[phase]
    return figure(
        f"{name}: energy of the sideways push removed",
        f"{middle:.0f} %",
        f"median of {len(removed)}, least {least:.0f} %",
        f"{goal:.0f} %, none below {WORST_PERCENT:.0f} %",
        met=middle >= goal and least >= WORST_PERCENT,
    )


def error_row(
    name: str, key: str, flown: dict[int, dict[str, float]], others: Sequence[dict[int, Any]]
) -> dict[str, Any]:
    """Error beside that without offsets and in free air, of the seeds that flew all three."""
    off, free = others
    seeds = sorted(set(flown) & set(off) & set(free))

    def rms_mm(flights: dict[int, dict[str, float]]) -> float:
        return 1000.0 * math.sqrt(statistics.fmean(flights[s][key] for s in seeds))

    without, with_them, in_free_air = map(rms_mm, (off, flown, free))
    detail = f"without offsets {without:.1f}, in free air {in_free_air:.1f} mm, {len(seeds)} seeds"
    return figure(name, f"{with_them:.1f} mm", detail)


def air_rows(flights: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """By air, companion and phase, over all seeds that flew."""

    def of(case: str) -> dict[int, dict[str, float]]:
        return {f["seed"]: f["figures"] for f in flights if f["case"] == case and counts(f)}

    rows = []
    free = of("free")
    for air in ("rough", "strong corner", "turned wall"):
        off = of(f"{air}, {OFF}")
        for companion in (DEFAULT, AMENDED):
            flown = of(f"{air}, {companion}")
            if not flown:
                continue
            for phase in PHASES:
                name = f"{air}, {companion}, {phase}"
                rows.append(push_row(name, phase, list(flown.values())))
                if set(flown) & set(off) & set(free):
                    for axis in ("sideways", "height"):
                        key = f"{phase}: {axis} m2"
                        rows.append(error_row(f"{name}: {axis} error", key, flown, (off, free)))
    return rows


def wrong_rows(flights: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Flights without contact; then by case contact, the least distance and the furthest way."""
    counted = [f["figures"] for f in flights if counts(f)]
    clear = sum(f["contact s"] == 0.0 for f in counted)
    said = f"{clear} of {len(counted)}"
    rows = [figure("flights without contact", said, "", "all", met=clear == len(counted))]
    for name in WRONG_CASES:
        flown = [f["figures"] for f in flights if f["case"] == name and counts(f)]
        if not flown:
            continue
        contact = max(f["contact s"] for f in flown)
        detail = f"of {len(flown)}; least gap {min(f['least lip to wall m'] for f in flown):.2f} m"
        detail += f", at most {max(f['off m'] for f in flown):.2f} m off"
        rows.append(
            figure(f"{name}: contact", f"{contact:.2f} s", detail, "0 s", met=contact == 0.0)
        )
    return rows


def asked_for(a: argparse.Namespace, *, amended: bool) -> Iterable[tuple[str, str, int]]:
    """Kind, case and seed of every flight; ``amended``: those that need another one before."""
    for seed in range(a.first, a.first + a.seeds):
        for name, case in CASES[a.kind].items():
            if a.px4 and case.set_in_flight is not None:
                continue  # a parameter of ArduCopter
            if a.only in name and (case.companion == AMENDED) == amended:
                yield a.kind, name, seed


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    p.add_argument("kind", choices=[*CASES, "one"], help="one: used by the program itself")
    p.add_argument("--px4", action="store_true", help="PX4 in place of ArduCopter")
    p.add_argument("--vehicle", type=Path, default=QUAD, help="vehicle file (the quadrotor)")
    p.add_argument("--first", type=int, default=1, help="first seed")
    p.add_argument("--seeds", type=int, default=2, help="how many")
    p.add_argument("--jobs", type=int, default=1, help="flights at a time")
    p.add_argument("--only", default="", metavar="TEXT", help="cases whose name holds this")
    p.add_argument("--model", type=Path, metavar="DIR", help="used by the program itself")
    p.add_argument("--json", type=Path, metavar="FILE", help="every flight")
    p.add_argument("--record", type=Path, metavar="DIR", help="keep recordings and truth here")
    add_option(p)
    return p


def main() -> int:
    """Fly, and print a table."""
    p = parser()
    a = p.parse_args()
    firmware = PX4 if a.px4 else ARDUCOPTER
    if not os.environ.get(firmware):
        p.error(f"{firmware} names no binary: docs/firmware.md")
    if a.px4 and a.jobs > 1:
        p.error("--px4: one flight at a time (--jobs 1): PX4 locks its place in /tmp")
    if a.kind == "one":
        raise_loopback()
        kind, name, seed = json.loads(a.only)
        flight = fly(
            kind=kind,
            name=name,
            seed=seed,
            folder=a.record,
            model=a.model,
            vehicle=a.vehicle,
            px4=a.px4,
        )
        print(json.dumps(flight))
        return 0
    flights = []
    if a.json is not None and a.json.exists():
        flights = json.loads(a.json.read_text(encoding="utf-8"))
    known = {(f["kind"], f["case"], f["seed"]) for f in flights}
    with tempfile.TemporaryDirectory() as scratch, ThreadPoolExecutor(a.jobs) as pool:
        for amended in (False, True):
            jobs = [job for job in asked_for(a, amended=amended) if job not in known]
            records = a.record or Path(scratch)
            asked = [
                pool.submit(fly_apart, records, *job, vehicle=a.vehicle, px4=a.px4) for job in jobs
            ]
            for one in tqdm(as_completed(asked), total=len(jobs), unit="flight", file=sys.stderr):
                flights.append(one.result())
                if a.json is not None:
                    a.json.write_text(json.dumps(flights, indent=1) + "\n", encoding="utf-8")
    mine = [f for f in flights if f["kind"] == a.kind]
    rows = air_rows(mine) if a.kind == "air" else wrong_rows(mine)
    for row in rows:
        print(
            f"{row['what']:70} {row['value']:>9}  {row.get('detail', ''):60} {row.get('goal', '')}"
        )
    print(f"{sum(map(counts, mine))} of {len(mine)} flights count")
    for f in mine:
        if "failed" in f:
            print(f"{f['case']}, seed {f['seed']}: {f['failed']}")
    write_result(a, rows, seeds=f"{a.first} to {a.first + a.seeds - 1}", simulated=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
