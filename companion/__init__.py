"""The flight program: MAVLink in, offset commands out.

``pipeline.step(state, sample, config)`` is the whole of what is decided; ``pipeline.initial_state(config)`` starts it.
It is pure: the live loop (``companion.flight``) and a replay (``replay.rerun``) get the same decisions from it.
"""

import logging

logging.getLogger(__name__).addHandler(
    logging.NullHandler()
)  # a program that imports this decides what is shown
