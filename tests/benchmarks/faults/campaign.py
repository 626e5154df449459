"""Flies one fault beside a wall and says when it was noticed, what the output did, and when all was well again."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from flight_case import Case, CasePilot, surroundings
from lockstep_faults import FaultyLockstep
from simulated import simulated
from vision import VisionEstimator

import models
from companion.adapt_options import Adapt
from companion.config import PipelineConfig
from companion.invariants.auditor import Auditor
from companion.sim.flight import SimulatedFlight
from companion.state.decision import Decision
from companion.vehicles import default_vehicle
from faults.tamper import Tamper, signer
from models.surrogate.store import DEFAULT
from models.vehicle import Rangefinder

HEIGHT_M = 0.9
WALL_M = 1.2
GAP_M = 0.30
LOW_M = 0.45
"""Take-off, wall from the lip at the origin, lip to wall while the fault lasts, height of the CG there."""
RECOVERY_S = 9.0
STACKS = ("ardupilot", "px4")
_SILENCE_S = 0.15
_BACK = 0.95
"""Of the authority: compensating again."""


@dataclass
class Bench:
    """What a fault may lay hands on."""

    world: FaultyLockstep
    pilot: CasePilot
    tamper: Tamper
    folder: Path

    @property
    def flight(self) -> SimulatedFlight:
        """The vehicle."""
        return self.world.flight

    @property
    def now_s(self) -> float:
        """Boot time."""
        return self.world.flight.time_s


Act = Callable[[Bench], None]


@dataclass(frozen=True)
class Fault:
    """One thing that goes wrong: ``begin``, ``each`` physics step while it lasts, ``end``."""

    name: str
    what: str
    begin: Act
    end: Act = lambda b: b.tamper.clear()
    each: Act | None = None
    during: Callable[[Bench], Iterator[float]] | None = None
    """In place of ``each``: a script, for as long as it takes."""
    seconds: float = 3.0
    noticed: bool = True
    """Offsets must go, or the stream stop. False: what is wrong cannot be seen, or does no harm."""
    recovers: bool = True
    lands: tuple[str, ...] = ()
    """Stacks that land by themselves, or by the pilot's will: on the ground is no contact then."""
    key: bytes | None = None
    """Of a signed link."""
    own_model: bool = False
    """The model is read from a copy of its own, in ``Bench.folder``."""
    off_m: float = 0.25
    """How far it may drive the vehicle."""
    silent_off_m: float | None = None
    """The same with the manners of ArduPilot where the program has promised to be silent: see ``silent_drift_m``."""
    touches_s: float = 0.0
    """Contact with the wall that physics does not let it avoid: the fault's own words say why."""
    clock_ms: int = 0
    """The autopilot's clock when the simulation starts."""
    ring: int = 0
    """Directions of a ring that sees the wall in place of the wall range."""
    vision: bool = False
    """Without GPS: the position is visual odometry, which finds its place again only when it is told to."""
    stacks: tuple[str, ...] = STACKS


@dataclass
class Seen:
    """One decision, and when."""

    at_s: float
    reasons: tuple[Any, ...]
    authority: float
    thrust: float
    tilt_rad: float
    sent: bool


class Observer(Auditor):
    """The auditor, remembering decisions."""

    def __init__(self, clock: Callable[[], float], **options: Any) -> None:
        super().__init__(**options)
        self._clock = clock
        self.seen: list[Seen] = []

    def decision(self, decision: Decision) -> None:
        """One decision of the flight program."""
        super().decision(decision)
        o = decision.offset
        self.seen.append(
            Seen(
                self._clock(), decision.reasons, decision.authority, abs(o.thrust), math.hypot(o.roll, o.pitch),
                decision.command is not None,
            )
        )  # fmt: skip


@dataclass(frozen=True)
class Result:
    """A row of the table. Times in seconds after the fault began, or ended; None: never."""

    fault: str
    stack: str
    compensated_before: bool
    noticed_s: float | None
    why: str
    thrust: float
    """Largest offsets while the fault lasted."""
    tilt_deg: float
    off_m: float
    """Furthest from where it was to be, from the fault to the end."""
    wall_s: float
    """Contact with the wall, and with the ground."""
    ground_s: float
    recovered_s: float | None
    outputs: int
    broken: tuple[str, ...] = field(default_factory=tuple)

    def as_json(self) -> dict[str, Any]:
        """Plain numbers."""
        return asdict(self)


def silent_drift_m(seconds: float) -> float:
    """How far a vehicle flies on its last setpoint, as ArduPilot does for GUID_TIMEOUT once the stream ends.

    At rest the hold's tilt is 1 degree RMS about its mean (docs/safety.md); whatever it is at the last setpoint goes on
    accelerating the vehicle.
    """
    return 0.5 * 9.80665 * math.tan(math.radians(1.0)) * seconds**2


@cache
def config(adapt: Adapt = Adapt.OFF) -> PipelineConfig:
    """The paper's vehicle with its model: offsets of a few per cent of thrust and a degree or two."""
    return PipelineConfig(vehicle=default_vehicle(), model=models.load(), adapt=adapt)


def copied_model(folder: Path) -> Path:
    """The shipped model in a folder of its own."""
    return Path(shutil.copytree(DEFAULT, folder / "model"))


def fly(fault: Fault, stack: str, seed: int = 1, adapt: Adapt = Adapt.OFF) -> Result:
    """One fault, in simulated time: the same seed gives the same result."""
    with TemporaryDirectory() as folder:
        return _fly(fault, stack, seed, config(adapt), Path(folder))


def _fly(fault: Fault, stack: str, seed: int, own: PipelineConfig, folder: Path) -> Result:
    times = [math.inf, math.inf]
    if fault.own_model:
        own = replace(own, model=models.load(copied_model(folder)))
    if fault.ring:
        ring = Rangefinder(target="wall", position_m=(0.0, 0.0, 0.0), ring=fault.ring)
        others = [sensor for sensor in own.vehicle.rangefinders if sensor.target != "wall"]
        own = replace(own, vehicle=replace(own.vehicle, rangefinders=(*others, ring)))
    benches: list[Bench] = []

    def script(p: CasePilot) -> Iterator[float]:
        yield from p.take_off(HEIGHT_M)
        yield from p.hand_over()
        for k in range(1, 13):
            p.go(0.0, (WALL_M - GAP_M) * k / 12, HEIGHT_M + (LOW_M - HEIGHT_M) * k / 12)
            yield 0.5
        yield 3.0
        p.judge()
        bench = benches[0]
        times[0] = bench.now_s
        fault.begin(bench)
        if fault.during is not None:
            yield from fault.during(bench)
        else:
            for _ in range(round(fault.seconds / 0.01)):
                if fault.each is not None:
                    fault.each(bench)
                yield 0.01
        times[1] = bench.now_s
        fault.end(bench)
        yield RECOVERY_S

    case = Case(fault.name, fault.what, script, px4=stack == "px4", wall_m=WALL_M)
    flight = simulated(
        own.vehicle, surroundings(case, own.vehicle), seed, px4=case.px4, vision=fault.vision
    )
    if isinstance(flight.estimator, VisionEstimator):
        flight.estimator.relocalised_every_s = math.inf

    def pilot(world: FaultyLockstep) -> CasePilot:
        p = _Pilot(world, script)
        benches.append(Bench(world, p, Tamper(world.wire, seed), folder))
        p.bench = benches[0]
        p.bench.tamper.clock_ms = fault.clock_ms
        if fault.key is not None:
            world.mav.signing.secret_key = fault.key
            world.mav.signing.sign_outgoing = True
            p.bench.tamper.signatures = signer(fault.key)
        return p

    world = FaultyLockstep(flight, pilot)
    observer = Observer(lambda: flight.time_s, vehicle=own.vehicle)
    world.auditor = observer
    world.fly(own, None)
    return _result(fault, stack, observer, benches[0].pilot, *times)


class _Pilot(CasePilot):
    bench: Bench

    def step(self) -> None:
        super().step()
        self.bench.tamper.step(self.bench.now_s)


def _result(
    fault: Fault, stack: str, observer: Observer, pilot: CasePilot, begun_s: float, ended_s: float
) -> Result:
    seen = observer.seen
    before = [s for s in seen if begun_s - 0.5 <= s.at_s < begun_s]
    during = [s for s in seen if begun_s <= s.at_s < max(ended_s, begun_s + 1.0)]
    noticed, why = _noticed(seen, begun_s, ended_s)
    after = next(
        (s for s in seen if s.at_s > ended_s and not s.reasons and s.authority > _BACK and s.sent),
        None,
    )
    report = observer.audit
    return Result(
        fault.name,
        stack,
        bool(before) and all(s.authority > 0.5 for s in before),
        noticed,
        why,
        round(max((s.thrust for s in during), default=0.0), 4),
        round(math.degrees(max((s.tilt_rad for s in during), default=0.0)), 2),
        round(max(pilot.judgement.off_m, pilot.judgement.height_loss_m, pilot.judgement.rise_m), 3),
        round(pilot.judgement.wall_s, 3),
        round(pilot.judgement.ground_s, 3),
        None if after is None else round(after.at_s - ended_s, 2),
        report.setpoints,
        tuple(report.broken()),
    )


def _noticed(seen: list[Seen], begun_s: float, ended_s: float) -> tuple[float | None, str]:
    """When offsets began to go, or the stream of decisions stopped, and why."""
    last_s = begun_s
    for s in seen:
        if s.at_s < begun_s:
            continue
        if s.at_s - last_s > _SILENCE_S:
            return round(last_s + _SILENCE_S - begun_s, 2), "silent"
        if s.at_s > ended_s + _SILENCE_S:
            return None, ""
        if s.reasons:
            return round(s.at_s - begun_s, 2), s.reasons[0].name.lower()
        last_s = s.at_s
    return (None, "") if last_s >= ended_s else (round(last_s + _SILENCE_S - begun_s, 2), "silent")


def complaints(fault: Fault, r: Result) -> list[str]:
    """What a result says against the program; empty where all is as promised."""
    out = list(r.broken)
    if not r.compensated_before:
        out.append("was not compensating before the fault")
    if fault.noticed and r.noticed_s is None:
        out.append("was not noticed")
    lands = r.stack in fault.lands
    if fault.recovers and not (lands and fault.during is None) and r.recovered_s is None:
        out.append(f"did not compensate again within {RECOVERY_S:g} s")
    if r.wall_s > max(fault.touches_s, 0.01):
        out.append(f"touched the wall for {r.wall_s:.2f} s")
    if r.ground_s > 0.01 and not lands:
        out.append(f"touched the ground for {r.ground_s:.2f} s")
    allowed = (
        fault.silent_off_m
        if fault.silent_off_m is not None and r.stack == "ardupilot"
        else fault.off_m
    )
    if r.off_m > allowed:
        out.append(f"driven {r.off_m:.2f} m off, {allowed:.2g} m allowed")
    return out


__all__ = ["Bench", "Fault", "Result", "complaints", "fly"]
