"""What adaptation knows before the first sample."""

from __future__ import annotations

from companion.adapt_options import Adapt
from companion.adaptation import judge
from companion.adaptation.adaptation import Adaptation
from companion.adaptation.apply import Applied
from companion.adaptation.beliefs import believed_of, wanted_of
from companion.adaptation.block_noise import floors
from companion.adaptation.channel import channels_of
from companion.adaptation.sizes import channels, prior, size_table
from companion.config import PipelineConfig
from companion.disturbance.adopted_effects import of_walls_alone
from models.common.frozen_copy import with_changes


def initial(config: PipelineConfig) -> Adaptation | None:
    """Before the first sample; None where nothing is to be learned."""
    if config.adapt is Adapt.OFF:
        return None
    table = size_table(config.vehicle, config.model)
    places = channels(table)
    through = channels_of(table)
    judged = tuple(judge.initial(channel) for channel in through)
    believed = believed_of(through, judged)
    shares = Applied((1.0,) * len(places))
    variance = floors(config.vehicle)
    learned = (False,) * len(places)
    state = Adaptation(
        table=table,
        sizes=prior(table),
        channels=through,
        judged=judged,
        believed=believed,
        wanted=shares,
        applied=shares,
        variance=variance,
        learned=learned,
        of_walls=of_walls_alone(config.model),
    )
    wanted = wanted_of(state)
    return with_changes(state, wanted=wanted, applied=wanted)
