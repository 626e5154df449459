"""In which air a scenario is flown, and which shipped model is the default there."""

from __future__ import annotations

from companion.sim.air import SurfaceLaw, disturbed
from companion.sim.flow_air import flow_air, require_scipy
from companion.sim.scenario import NAMES
from models.common.errors import ConfigError

FLOW = "corner_cfd"
"""The corner in the air of the flow simulation, the same for every seed; all others have a law drawn by the seed."""


def law_of(scenario: str, seed: int) -> SurfaceLaw:
    """What ground and wall do in a scenario. Raises ConfigError where that needs a package which is not there."""
    if scenario == FLOW:
        return flow_air()
    return disturbed(seed)


def default_model(scenario: str) -> str | None:
    """The shipped model that flies unless another is named: in the air of the flow simulation its surrogate, made of
    the places that this air is not made of; None: the same as on a real vehicle."""
    if scenario == FLOW:
        return f"{FLOW}_half"
    return None


def check_scenario(name: str) -> None:
    """Raises ConfigError where there is no such scenario, or where it needs a package which is not there."""
    if name not in NAMES:
        raise ConfigError(f"sim:{name}: no such flight; there are {', '.join(NAMES)}")
    if name == FLOW:
        require_scipy()
