"""How much of a disturbance is fed forward: less where its growth towards a surface would swing the loop."""

from __future__ import annotations

from models.vehicle import Vehicle

GAIN = 0.95
"""Of the modelled disturbance, where nothing speaks against it."""
DAMPING_SHARE = 0.2
"""Of the loop's damping that delayed feed-forward towards a surface may take away."""
RESIDUAL_DELAY_S = 0.06
"""What is left of the delay of a side force behind the lead."""
STIFFNESS_STEP_M = 0.02
"""Step of the difference quotient of a wall's pull: above the noise of a surrogate, below its e-fold of 0.1 m."""


def stable_gain(pull_n_per_m: float, vehicle: Vehicle, damping_1_s: float) -> float:
    """Attraction that grows towards a surface, fed forward late, is negative damping.

    Gain times stiffness times delay stays below a fifth of the loop's own damping (acceleration per m/s).
    """
    if pull_n_per_m <= 0.0:
        return GAIN
    allowed = DAMPING_SHARE * damping_1_s * vehicle.mass_kg
    return min(GAIN, allowed / (pull_n_per_m * RESIDUAL_DELAY_S))
