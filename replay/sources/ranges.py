"""Which of several rangefinders that look one way is read."""

from __future__ import annotations

from dataclasses import replace

from models.air_state import DIRECTIONS
from replay.flightlog import Beam, FlightLog, SourceChoice
from replay.sources.candidates import Candidate, pick


def choose_ranges(log: FlightLog, settings: dict[str, str]) -> tuple[FlightLog, list[SourceChoice]]:
    """The choices of every direction with a rangefinder. What ``settings`` names is the only one that is kept."""
    choices = []
    for direction in DIRECTIONS:
        quantity = f"range_{direction}"
        beams = {_name(beam): beam for beam in log.beams if beam.name == direction}
        wanted = settings.get(quantity)
        if wanted is not None:
            candidates = [Candidate(name=name) for name in beams]
            choice = pick(quantity, candidates, wanted=wanted)
            assert choice is not None
            aside = [beams[name] for name in choice.others]
            log = replace(log, beams=tuple(beam for beam in log.beams if beam not in aside))
            choices.append(choice)
            continue
        best = log.beam(direction)
        if best is not None:
            choices.append(_choice(quantity, best, beams))
    return log, choices


def _choice(quantity: str, best: Beam, beams: dict[str, Beam]) -> SourceChoice:
    why = "the only one"
    if len(beams) > 1:
        why = f"{best.share_good:.0%} of its readings are good"
    others = tuple(name for name, beam in beams.items() if beam is not best)
    return SourceChoice(quantity=quantity, chosen=_name(best), others=others, why=why)


def _name(beam: Beam) -> str:
    return f"{beam.source} {beam.sensor_id} of component {beam.component}"
