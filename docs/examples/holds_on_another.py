"""Learn on one flight, judge on another, and foretell its motion half a second ahead.

python docs/examples/holds_on_another.py MONDAY FRIDAY VEHICLE.toml
"""

import sys

from replay import Diagnosis

if len(sys.argv) < 4:
    sys.exit(__doc__)
monday, friday, vehicle = sys.argv[1:]
diagnosis = Diagnosis(vehicle=vehicle, model=None).fit(monday)
print(f"explained on another flight: {diagnosis.score(friday):.2f} of the residual")
print(diagnosis.predict(friday, horizon_s=0.5).as_text())
diagnosis.save("amended")
