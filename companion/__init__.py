"""The flight program: MAVLink in, offset commands out.

``companion.step(state, sample, config)`` is all that is decided; ``companion.initial_state(config)`` starts it. It is
pure: the live loop (``companion.flight.loop``) and a replay (``replay.rerun``) get the same decisions from it.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from models.common.lazy_exports import exports

if TYPE_CHECKING:
    from companion.config import PipelineConfig
    from companion.pipeline import initial_state, step
    from companion.state.decision import Decision
    from companion.state.pipeline_state import PipelineState

    __version__: str

__all__ = ["Decision", "PipelineConfig", "PipelineState", "initial_state", "step"]

_HOMES = {
    "PipelineConfig": "companion.config",
    "Decision": "companion.state.decision",
    "PipelineState": "companion.state.pipeline_state",
    "initial_state": "companion.pipeline",
    "step": "companion.pipeline",
}
__getattr__, __dir__ = exports(__name__, _HOMES)

# A program that imports this decides what is shown.
logging.getLogger(__name__).addHandler(logging.NullHandler())
