"""Train a surrogate on a CSV of one's own (h_m, d_m, rpm, Fx_N ... Mz_Nm), and save it for flight.

python docs/examples/own_surrogate.py FAN.csv DIR [METHOD]
"""

import sys

import models

if len(sys.argv) < 3:
    sys.exit(__doc__)
data, folder, *method = sys.argv[1:]
surrogate = models.train(data, *method)
print(surrogate)
for axis, score in surrogate.info["metrics"]["test"].items():
    print(axis, score["r2"])
models.save_model(folder, surrogate)
