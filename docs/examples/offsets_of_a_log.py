"""What the companion would have sent on a recorded flight: the pipeline of flight, message by message.

python docs/examples/offsets_of_a_log.py LOG.tlog [VEHICLE.toml]
"""

import subprocess
import sys

log, *vehicle = sys.argv[1:]
options = ["--vehicle", vehicle[0]] if vehicle else []
command = [sys.executable, "-m", "replay", "run", log, *options]
print(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
