"""Simulated flights whose every output is checked against the promises of companion/invariants/."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from flight_case import Case, CasePilot, surroundings
from lockstep_faults import FaultyLockstep
from simflight import vehicle
from simulated import simulated

import models
from companion.config import PipelineConfig
from companion.invariants.auditor import Auditor
from companion.invariants.requirements import Audit


@cache
def config(name: str = "tandem") -> PipelineConfig:
    return PipelineConfig(vehicle=vehicle(name), model=models.load())


def fly_audited(
    case: Case, seed: int = 1, record: Path | None = None, name: str = "tandem", **changes: bool
) -> tuple[FaultyLockstep, CasePilot, Audit]:
    """One case in lockstep; the pilot holds what truly happened."""
    from dataclasses import replace

    own = replace(config(name), **changes)
    flight = simulated(
        own.vehicle, surroundings(case, own.vehicle), seed, px4=case.px4, parameters=case.parameters
    )
    pilots: list[CasePilot] = []

    def pilot(world: FaultyLockstep) -> CasePilot:
        pilots.append(CasePilot(world, case.script))
        return pilots[0]

    world = FaultyLockstep(flight, pilot)
    world.auditor = Auditor(own.vehicle, dry_run=own.dry_run)
    world.fly(own, record)
    return world, pilots[0], world.auditor.audit
