"""Sizes of the same effects on several flights of one vehicle, each by itself.

python docs/examples/compare_flights.py VEHICLE.toml LOG...
"""

import sys

from replay import Diagnosis

if len(sys.argv) < 3:
    sys.exit(__doc__)
vehicle, *logs = sys.argv[1:]
for log in logs:
    for row in Diagnosis(vehicle=vehicle, model=None).fit(log).effects_:
        if row.value is not None and row.low is not None:
            print(
                f"{log}: {row.effect} {row.parameter} {row.value:.3g} [{row.low:.3g}, {row.high:.3g}]"
            )
