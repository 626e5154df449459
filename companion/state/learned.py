"""What the flight has shown of this vehicle on this day."""

from __future__ import annotations

from dataclasses import dataclass, field

from companion.adaptation.adaptation import Adaptation
from companion.control.engagement import Balance
from companion.control.hover_thrust import HoverThrust

_NO_BALANCE = Balance()


@dataclass(frozen=True)
class Learned:
    """The thrust that hovers, the tilt that balances wind, and the sizes of effects."""

    hover: HoverThrust = field(default_factory=HoverThrust)
    balance: Balance = _NO_BALANCE
    adaptation: Adaptation | None = None
    """The sizes measured in flight; None where nothing is to be measured."""
