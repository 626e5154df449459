"""What ground and wall do to a fan, by the shipped surrogate.

python docs/examples/query_surrogate.py
"""

import numpy as np

import models

surrogate = models.load()
heights = np.array([0.2, 0.4, 0.8, np.inf])
answer = surrogate.query(heights, np.inf, 4000.0)
for h, wrench, trust in zip(heights, answer.wrench, answer.trust, strict=True):
    print(f"{h:4.1f} m above ground: {wrench[2]:.2f} N of lift, trusted {trust:.0%}")
surrogate.plot().save("fan.html")
