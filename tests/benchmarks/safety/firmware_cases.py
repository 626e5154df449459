"""The ways to crash that were found on the real ArduCopter and PX4, flown in ``sim:`` in lockstep, one table.

``python tests/benchmarks safety.firmware_cases [NAME…] [--seed 1] [--adapt full] [--json FILE] [--compare OLD.json]``.
Everything is simulated; the same seed gives the same numbers on every machine, so two versions of the program can be
compared.
The manners of the two firmwares are those of ``companion/sim`` (docs/lab/simulator.md).
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from flight_case import WIRE_S, Case, CasePilot, Judgement, Outcome, fly_case

from companion.adapt_options import Adapt
from companion.config import PipelineConfig
from companion.sim.autopilot import Mode
from companion.sim.sensors import RangeFault
from companion.vehicles import QUAD
from models.common.errors import UserError
from models.surrogate.empty import empty_model
from models.vehicle import load_vehicle

HEIGHT_M = 1.5
NEAR_M = 0.15
"""Lip to wall in the cases at a wall: as in the flights on the real firmwares."""
SLOW_LOOP = {"ATC_ANG_RLL_P": 2.25, "ATC_ANG_PIT_P": 2.25, "ATC_INPUT_TC": 0.3}
BODY_OFFSET_NED = 9


def to_the_wall(
    p: CasePilot, wall_m: float, gap_m: float = NEAR_M, height_m: float = 1.0
) -> Iterator[float]:
    """Under the companion's hand to ``gap_m`` from the wall, slowly."""
    steps = 24
    for k in range(1, steps + 1):
        p.go((wall_m - gap_m) * k / steps, 0.0, HEIGHT_M + (height_m - HEIGHT_M) * k / steps)
        yield 0.5
    yield 3.0


WALL_M = 1.6

# -- PX4 -------------------------------------------------------------------------------------------------------------


def there_by_sticks(p: CasePilot) -> Iterator[float]:
    """The pilot flies some metres forward, stops, and hands over again."""
    p.mode(Mode.POSHOLD)
    p.sticks(forward=1.0)
    yield 4.5
    p.sticks()
    yield 3.0
    p.judge()
    p.mode(Mode.GUIDED)
    yield 8.0


def excursion_then_offboard(p: CasePilot) -> Iterator[float]:
    yield from p.take_off(HEIGHT_M)
    yield from there_by_sticks(p)


def leave_and_come_back(p: CasePilot) -> Iterator[float]:
    yield from p.take_off(HEIGHT_M)
    yield from p.hand_over()
    yield from there_by_sticks(p)


def engage(p: CasePilot) -> Iterator[float]:
    yield from p.take_off(HEIGHT_M)
    p.judge()
    yield from p.hand_over()
    yield 8.0


def hold_then(act: str, *arguments: float, seconds: float = 8.0, gap_m: float | None = None) -> Any:
    """Engage, go to the wall where ``gap_m`` is given, then something happens to the companion's process."""

    def script(p: CasePilot) -> Iterator[float]:
        yield from p.take_off(HEIGHT_M)
        yield from p.hand_over()
        if gap_m is not None:
            yield from to_the_wall(p, WALL_M, gap_m)
        else:
            yield 9.0  # what was asked for at the start has been answered long ago
        yield from p.until_phase(
            0.83
        )  # a stall then begins shortly before a heartbeat, as in the flight that fell
        p.judge()
        getattr(p.world, act)(*arguments)
        yield seconds

    return script


def late_data(p: CasePilot) -> Iterator[float]:
    yield from p.take_off(HEIGHT_M)
    yield from p.hand_over()
    p.go(0.6, 0.0, HEIGHT_M)
    p.judge(north=0.6)
    yield 0.3
    p.world.wire.down_delay_s = 0.6
    yield 2.0
    p.world.wire.down_delay_s = WIRE_S
    yield 5.0


def gps_lost(seconds: float) -> Any:
    def script(p: CasePilot) -> Iterator[float]:
        yield from p.take_off(HEIGHT_M)
        yield from p.hand_over()
        p.judge()
        p.flight.estimator.gps = False
        yield seconds

    return script


# -- ArduPilot -------------------------------------------------------------------------------------------------------


def started_at_boot(p: CasePilot) -> Iterator[float]:
    yield 1.0
    p.judge(up=0.0)
    yield from p.take_off(HEIGHT_M)
    yield 6.0
    reached = -p.flight.body.position[2]
    p.notes.append(f"take-off to {HEIGHT_M} m ended at {reached:.2f} m")
    p.judge(up=HEIGHT_M - reached)
    yield 1.0


def approach(p: CasePilot) -> Iterator[float]:
    yield from p.take_off(HEIGHT_M)
    yield from p.hand_over()
    p.judge()
    yield from to_the_wall(p, WALL_M, 0.25)
    yield 6.0


def slow_positions(p: CasePilot) -> Iterator[float]:
    p.world.link.position_hz, p.world.link.position_late_s = 10.0, 0.05
    yield from approach(p)


def body_offset(p: CasePilot) -> Iterator[float]:
    yield from p.take_off(HEIGHT_M)
    yield from p.hand_over()
    p.go(2.0, 1.0, HEIGHT_M)
    yield 5.0
    p.silent()
    yield 1.0
    p.judge(up=0.2)
    p.once(BODY_OFFSET_NED, 0.0, 0.0, -0.2)
    yield 8.0


def velocity_only(p: CasePilot) -> Iterator[float]:
    yield from p.take_off(HEIGHT_M)
    yield from p.hand_over()
    start = p.flight.body.position[0]
    p.judge(north=1.5)
    p.move(0.3, 0.0, 0.0)
    yield 5.0
    p.silent()
    yield 4.0
    p.notes.append(f"0.3 m/s for 5 s moved it {p.flight.body.position[0] - start:.2f} m")
    p.judge(north=start + 1.5 - p.flight.body.position[0])
    yield 1.0


def targets_during_loiter(p: CasePilot) -> Iterator[float]:
    yield from p.take_off(HEIGHT_M)
    yield from p.hand_over()
    p.go(0.0, 0.0, HEIGHT_M)
    yield 2.0
    p.mode(Mode.LOITER)
    for k in range(20):
        p.go(0.0, 0.05 * k, HEIGHT_M)
        yield 0.2
    p.mode(Mode.GUIDED)
    p.silent()
    p.judge()
    yield 6.0


def range_fault(fault: RangeFault, sensor: int, height_m: float) -> Any:
    def script(p: CasePilot) -> Iterator[float]:
        yield from p.take_off(HEIGHT_M)
        yield from p.hand_over()
        if sensor == 1:
            yield from to_the_wall(p, WALL_M, 0.2)
        else:
            p.go(0.0, 0.0, height_m)
            yield 8.0
        p.judge()
        p.flight.ranges[sensor].fault = fault
        yield 3.0
        if fault is RangeFault.FROZEN:
            p.go(0.0, 0.0, height_m + 0.5)
            p.judge(up=0.5)
            yield 4.0

    return script


def wind_step(p: CasePilot) -> Iterator[float]:
    yield from p.take_off(HEIGHT_M)
    yield from p.hand_over()
    p.judge()
    p.flight.body.wind = (4.0, 3.0, 0.0)
    yield 6.0
    p.flight.body.wind = (0.0, 0.0, 0.0)
    yield 6.0


CASES = (
    Case("px4_excursion_then_offboard", "4 m away by sticks, then OFFBOARD", excursion_then_offboard, px4=True),
    Case("px4_leave_and_come_back", "OFFBOARD, 4 m away in Position, OFFBOARD", leave_and_come_back, px4=True),
    Case("px4_default_hover_thrust", "MPC_THR_HOVER 0.5, true 0.70", engage, px4=True, true_hover=0.70),
    Case("px4_heavy_hover_thrust", "MPC_THR_HOVER 0.5, true 0.30", engage, px4=True, true_hover=0.30),
    Case("px4_stall_1.5s", "the companion stands still for 1.5 s", hold_then("stall", 1.5), px4=True),
    Case("px4_stall_3s", "the companion stands still for 3 s", hold_then("stall", 3.0, seconds=12.0), px4=True),
    Case("px4_stall_3s_hover_0.70", "the same, where the file's hover thrust is wrong",
         hold_then("stall", 3.0, seconds=12.0), px4=True, true_hover=0.70, parameters={"MPC_THR_HOVER": 0.7}),
    Case("px4_late_data", "telemetry 0.6 s late for 2 s, on the move", late_data, px4=True),
    Case("px4_interrupt_at_wall", "Ctrl-C 15 cm from the wall", hold_then("interrupt", gap_m=NEAR_M), px4=True,
         wall_m=WALL_M),
    Case("px4_kill_at_wall", "killed 15 cm from the wall", hold_then("kill", gap_m=NEAR_M), px4=True, wall_m=WALL_M),
    Case("px4_kill_restart", "killed, back after 1.5 s", hold_then("kill", 1.5, seconds=10.0), px4=True),
    Case("px4_gps_lost", "GPS off for 21 s", gps_lost(21.0), px4=True),
    Case("px4_engage", "take-off, OFFBOARD: engaging alone", engage, px4=True),
    Case("ap_engage", "take-off, GUIDED: engaging alone", engage),
    Case("ap_started_at_boot", "the companion runs during a GUIDED take-off to 1.5 m", started_at_boot),
    Case("ap_slow_loop", "ATC_ANG 2.25, ATC_INPUT_TC 0.3, to 25 cm from a wall", approach, parameters=SLOW_LOOP,
         wall_m=WALL_M),
    Case("ap_slow_loop_10hz", "the same with positions at 10 Hz, 50 ms late", slow_positions, parameters=SLOW_LOOP,
         wall_m=WALL_M),
    Case("ap_positions_10hz", "positions at 10 Hz, 50 ms late, the default loop", slow_positions, wall_m=WALL_M),
    Case("ap_late_data", "telemetry 0.6 s late for 2 s, on the move", late_data),
    Case("ap_stall_1.5s", "the companion stands still for 1.5 s", hold_then("stall", 1.5)),
    Case("ap_stall_3s", "the companion stands still for 3 s", hold_then("stall", 3.0, seconds=12.0)),
    Case("ap_kill_at_wall", "killed 15 cm from the wall, GUID_TIMEOUT 0.5", hold_then("kill", gap_m=NEAR_M),
         parameters={"GUID_TIMEOUT": 0.5}, wall_m=WALL_M),
    Case("ap_interrupt_at_wall", "Ctrl-C 15 cm from the wall", hold_then("interrupt", gap_m=NEAR_M), wall_m=WALL_M),
    Case("ap_gps_lost", "GPS off for 5 s: until its own failsafe", gps_lost(5.0)),
    Case("ap_body_offset", "'climb 0.2 m' in BODY_OFFSET_NED, 2.2 m from the origin", body_offset),
    Case("ap_velocity_only", "0.3 m/s for 5 s", velocity_only),
    Case("ap_targets_during_loiter", "targets ran on 1 m during LOITER", targets_during_loiter),
    Case("ap_down_echo_lost", "the down beam loses its echo at 0.3 m", range_fault(RangeFault.LOST, 0, 0.3)),
    Case("ap_forward_echo_lost", "the forward beam loses its echo 20 cm from the wall",
         range_fault(RangeFault.LOST, 1, 1.0), wall_m=WALL_M),
    Case("ap_down_range_frozen", "the down beam repeats itself, then a climb", range_fault(RangeFault.FROZEN, 0, 0.5)),
    Case("ap_down_range_frozen_high", "the same at 2 m", range_fault(RangeFault.FROZEN, 0, 2.0)),
    Case("ap_wind_5_m_s", "a gust of 5 m/s for 6 s", wind_step),
)  # fmt: skip


def fly_one(
    name: str, seed: int, vehicle: Path | None, record: Path | None, adapt: Adapt = Adapt.OFF
) -> Outcome:
    """One case with the shipped quadrotor or another file, in free-air rotors (``--model none``)."""
    case = next(c for c in CASES if c.name == name)
    declared = load_vehicle(vehicle or QUAD)
    config = PipelineConfig(vehicle=declared, model=empty_model(declared), adapt=adapt)
    log, truth = (record / f"{name}.tlog", record / f"{name}.truth.csv") if record else (None, None)
    return fly_case(case, declared, config, seed, truth=truth, record=log)


def row(outcome: Mapping[str, Any]) -> str:
    contact = outcome["ground_s"] + outcome["wall_s"]
    where = "ground" if outcome["ground_s"] >= outcome["wall_s"] else "wall"
    touched = f"{contact:5.1f} s {where}" if contact > 0.01 else "    -"
    return (
        f"{outcome['case']:27}{outcome['height_loss_m']:8.2f}{outcome['rise_m']:8.2f}{outcome['off_m']:8.2f}{outcome['tilt_deg']:8.1f}"
        f"{outcome['speed_m_s']:8.2f}  {touched:14}{outcome['engaged_s']:6.1f}  {'; '.join(outcome['notes'])}"
    ).rstrip()


HEAD = f"{'case':27}{'loss m':>8}{'rise m':>8}{'off m':>8}{'tilt °':>8}{'m/s':>8}  {'contact':14}{'flown':>6}"


def main() -> int:
    """Fly and print."""
    p = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    p.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help="cases to fly (default: all); a part of a name is enough",
    )
    p.add_argument("--list", action="store_true", help="say what the cases are")
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--vehicle", type=Path, help="vehicle file (default: the shipped quadrotor)")
    p.add_argument(
        "--record", type=Path, metavar="DIR", help="keep a .tlog and the truth of each case here"
    )
    p.add_argument(
        "--adapt", choices=[m.value for m in Adapt], default="full", help="as companion --adapt"
    )
    p.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    p.add_argument("--json", metavar="FILE", help="- for stdout")
    p.add_argument(
        "--compare", type=Path, metavar="OLD.json", help="print these earlier outcomes above each"
    )
    a = p.parse_args()
    names = [c.name for c in CASES if not a.names or any(part in c.name for part in a.names)]
    if a.list or not names:
        print("\n".join(f"{c.name:27}{c.what}" for c in CASES))
        return 0 if a.list else 2
    old: dict[str, Any] = {}
    try:
        if a.compare is not None:
            old = {o["case"]: o for o in json.loads(a.compare.read_text(encoding="utf-8"))["cases"]}
        if a.record is not None:
            a.record.mkdir(parents=True, exist_ok=True)
        outcomes = fly_all(names, a)
    except UserError as error:
        print(f"firmware_cases: {error}", file=sys.stderr)
        return error.exit_code
    found = {
        "simulated": True,
        "lockstep": True,
        "seed": a.seed,
        "cases": [o.as_json() for o in outcomes],
    }
    text = json.dumps(found, indent=1)
    if a.json not in (None, "-"):
        Path(a.json).write_text(text + "\n", encoding="utf-8")
    if a.json == "-":
        print(text)
        return 0
    print(f"simulated, seed {a.seed}\n{HEAD}")
    for outcome in outcomes:
        if outcome.case in old:
            print("was " + row(old[outcome.case]))
        print(row(outcome.as_json()))
    touched = sum(o.judgement.contact_s > 0.01 for o in outcomes)
    print(f"{touched} of {len(outcomes)} touch something")
    return 0


def fly_all(names: Sequence[str], a: argparse.Namespace) -> list[Outcome]:
    """Several at a time, in the order of the table."""
    rest = (names, repeat(a.seed), repeat(a.vehicle), repeat(a.record), repeat(Adapt(a.adapt)))
    if a.workers == 1:
        return list(map(fly_one, *rest))
    with ProcessPoolExecutor(a.workers, mp_context=get_context("spawn")) as pool:
        return list(pool.map(fly_one, *rest))


__all__ = ["CASES", "Judgement", "fly_one", "main"]

if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
