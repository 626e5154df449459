"""Move a quadcopter ahead by its model: a hover, and the same with 5 % more speed on all rotors.

python docs/examples/motion_ahead.py VEHICLE.toml RPM
"""

import sys

import numpy as np

from models.vehicle import load_vehicle
from replay import FlightModel, rollout

if len(sys.argv) < 3:
    sys.exit(__doc__)
vehicle = load_vehicle(sys.argv[1])
rpm = float(sys.argv[2])
start = np.zeros((2, 13))
start[:, 6] = 1.0  # level, at rest
speeds = np.full((2, 100, len(vehicle.rotors)), rpm)
speeds[1] *= 1.05
states = rollout(FlightModel(vehicle), start, speeds, step_s=0.01)
for name, state in zip(("hover", "5 % more"), states[:, -1], strict=True):
    print(f"{name}: {-state[2]:+.2f} m higher and {-state[5]:+.2f} m/s up after a second")
