"""Read a log as arrays, and write its attitude and speeds as a CSV.

python docs/examples/read_log.py LOG attitude.csv
"""

import csv
import sys

from replay import load

if len(sys.argv) < 3:
    sys.exit(__doc__)
log, out = sys.argv[1:]
flight = load(log)[0]
attitude = flight.attitude
assert attitude is not None, "the log holds no attitude"
velocity = flight.velocity.at(attitude.t_s, max_gap_s=0.5)
with open(out, "w", newline="") as file:
    writer = csv.writer(file)
    writer.writerow(["t_s", "w", "x", "y", "z", "vn", "ve", "vd"])
    for t, q, v in zip(attitude.t_s, attitude.values, velocity, strict=True):
        writer.writerow([t, *q, *v])
print(f"{flight.duration_s:.0f} s, {len(attitude.t_s)} attitudes written to {out}")
