"""How far modelled lift over weight may be from 1: beyond, model, vehicle file and vehicle do not belong together."""

from __future__ import annotations

BY_COEFFICIENT = (1.0 / 1.35, 1.35)
"""At the rotor speed that ``ct`` gives for hover: a coefficient from a thrust stand is 10 to 20 % off in flight."""
IN_HOVER = (0.75, 1.3)
"""At measured rotor speeds while it hovers (``--check``)."""
IN_FLIGHT = (0.6, 1.6)
"""Averaged over a flight: a third of payload, the ground's cushion and a coefficient that is a fifth off stay inside; a
model or a file of another vehicle does not."""
JUDGED = (0.5, 1.8)
"""Of a log: outside, its lift and moments are not judged at all."""
