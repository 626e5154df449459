"""One sample of the accelerometer into the block that is being filled."""

from __future__ import annotations

import math

from companion.adaptation import block as block_of
from companion.adaptation.adaptation import Adaptation
from companion.adaptation.block import BLOCK_S, Block
from companion.adaptation.gates import Situation, pause
from companion.adaptation.vanes import vane_outputs
from companion.config import PipelineConfig
from companion.mavlink.samples import Imu
from models.common.frozen_copy import with_changes

_LEAST_SAMPLES = 4
"""Of the accelerometer in a block: 20 Hz, as diagnosis asks for moments."""
_IMU_GAP_S = 0.1
"""A longer silence of the accelerometer starts a new block."""
_PAUSE_S = 0.6
"""After a reason not to learn has gone: what it did to the filters of ranges and rotors has gone too."""
_SOURCE_SILENT_S = 1.0
_SILENT = (math.nan,) * 16


def hear(known: Adaptation, here: Situation, imu: Imu, config: PipelineConfig) -> Adaptation:
    """The adaptation one sample of an accelerometer on."""
    now_s = imu.t_s
    if imu.source != known.source:
        if now_s - known.heard_s < _SOURCE_SILENT_S:
            return known
        known = with_changes(known, source=imu.source, block=None)
    disturbance = here.disturbance
    rows = here.estimates.rows
    why = pause(here, imu, config, known.clear)
    if why is not None:
        return with_changes(
            known,
            heard_s=now_s,
            paused=why,
            paused_s=now_s,
            block=None,
            full=None,
            innovation=None,
            clear=None,
        )
    if now_s - known.paused_s < _PAUSE_S:
        return with_changes(known, heard_s=now_s)
    block = known.block
    if block is not None and now_s == block.end_s:
        return known  # sent twice
    full = known.full
    if block is None or not 0.0 < now_s - block.end_s <= _IMU_GAP_S:
        block = block_of.begin(imu)
    else:
        block = _longer(block, here, imu, config)
        if block.end_s - block.start_s >= BLOCK_S - 1e-6:
            full = None
            if block.samples >= _LEAST_SAMPLES and disturbance is not None and rows is not None:
                full = (block, disturbance, rows)
            block = block_of.follow(block)
    return with_changes(
        known, heard_s=now_s, paused=None, block=block, full=full, clear=disturbance
    )


def _longer(block: Block, here: Situation, imu: Imu, config: PipelineConfig) -> Block:
    """The block with what is known at this sample."""
    disturbance = here.disturbance
    position = here.estimates.position
    servo = here.estimates.servo
    assert disturbance is not None
    assert disturbance.parts is not None
    assert position is not None
    vanes = vane_outputs(config.vehicle, _SILENT if servo is None else servo.pwm_us)
    return block_of.add(block, imu, disturbance.parts, position.velocity_ned, vanes)
