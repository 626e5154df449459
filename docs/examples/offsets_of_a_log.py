"""What the companion would have sent on a recorded flight: the pipeline of flight, message by message.

python docs/examples/offsets_of_a_log.py LOG.tlog VEHICLE.toml
"""

import sys
from pathlib import Path

from companion.config import PipelineConfig
from models.choice import choose
from models.vehicle import load_vehicle
from replay.rerun.report import play

if len(sys.argv) < 3:
    sys.exit(__doc__)
log, file = sys.argv[1:]
vehicle = load_vehicle(file)
chosen = choose(vehicle, "none")
config = PipelineConfig(vehicle=vehicle, model=chosen.model)
decisions = list(play(Path(log), config, None, {}, quiet=True).decisions)
print(f"{len(decisions)} decisions; the last: {decisions[-1]}")
