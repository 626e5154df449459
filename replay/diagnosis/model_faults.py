"""A model or vehicle file of another vehicle: said before anything that the search would make of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from models.choice import Choice
from models.common.frames import GRAVITY
from models.vehicle.lift_ratio import IN_FLIGHT
from replay.residual.record import Record


def model_faults(records: Sequence[Record], chosen: Choice | None) -> list[dict[str, str]]:
    """Entries for ``log_faults``: sizes that contradict each other, and a modelled lift that did not fly.

    Nothing is said of a lift that the log's own faults keep from being judged.
    """
    low, high = IN_FLIGHT
    if chosen is None:
        out = []
    else:
        out = [
            {"channel": "model", "what": f"is of another fan than the vehicle file: {wrong}"}
            for wrong in chosen.contradictions
        ]
    for record in records:
        context = record.context
        valid = record.valid
        felt = context.vehicle.mass_kg * np.linalg.norm(context.state.specific_force, axis=1)
        lift = context.thrust.sum(axis=1)
        share = lift[valid] / np.maximum(felt[valid], 0.1 * context.vehicle.mass_kg * GRAVITY)
        if np.isfinite(share).any():
            ratio = float(np.nanmedian(share))
        else:
            ratio = 1.0
        if 2 in record.axes and not low <= ratio <= high:
            if context.model is None:
                source = "vehicle file"
            else:
                source = "model"
            what = (
                f"{record.name}: modelled lift is {ratio:.2g} times the lift that flew; of "
                "another vehicle?"
            )
            out.append({"channel": source, "what": what})
    return out
