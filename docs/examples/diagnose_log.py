"""What the declared model lacks on a log.

python docs/examples/diagnose_log.py LOG VEHICLE.toml
"""

import sys

from replay import Diagnosis

if len(sys.argv) < 3:
    sys.exit(__doc__)
log, vehicle = sys.argv[1:]
diagnosis = Diagnosis(vehicle=vehicle, model=None).fit(log)
print(diagnosis.answer_.verdict)
print(diagnosis.effects_)
diagnosis.plot().save("answer.html")
