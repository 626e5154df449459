"""Which model a command uses: the one that is named, or the shipped one where it is of the vehicle's fan."""

from __future__ import annotations

from dataclasses import dataclass

from models.common.errors import ConfigError
from models.surrogate.empty import empty_model
from models.surrogate.fan_identity import contradictions
from models.surrogate.fan_surrogate import FanSurrogate
from models.surrogate.store import load
from models.vehicle import Vehicle

NONE = "none"


@dataclass(frozen=True)
class Choice:
    """A model, what it is called, and what is to be said about it."""

    model: FanSurrogate
    name: str
    """A directory, ``shipped`` or ``none``."""
    contradictions: tuple[str, ...] = ()
    """Of a named model and the vehicle file."""
    note: str | None = None
    """Why the shipped model is not used."""

    @property
    def judged(self) -> FanSurrogate | None:
        """The model that logs are judged by; None where nothing is known of ground and wall."""
        if self.name == NONE:
            return None
        return self.model


def choose(vehicle: Vehicle, name: str | None, shipped: str | None = None) -> Choice:
    """``name`` as given on a command line: a directory, ``none``, or None for the default.

    The default is the shipped model, or another of those that ship (``shipped``), and no model (``none``) for a
    vehicle with another fan. Raises ModelError for a directory that cannot be loaded, ConfigError where ``none`` needs
    a ``ct`` that the vehicle file does not give.
    """
    if name == NONE:
        return Choice(empty_model(vehicle), NONE)
    model = load(name or shipped)
    wrong = contradictions(vehicle, model)
    if name is not None or not wrong:
        return Choice(model, name or shipped or "shipped", wrong)
    note = (
        f"the shipped model is of another fan ({'; '.join(wrong)}): without model, as with "
        "--model none"
    )
    try:
        return Choice(empty_model(vehicle), NONE, note=note)
    except ConfigError:
        raise ConfigError(
            "vehicle file: key 'fan.ct' is missing, and the shipped model is of another fan "
            f"({'; '.join(wrong)}): give ct, or --model of this vehicle"
        ) from None


def choose_to_fly(vehicle: Vehicle, name: str | None, shipped: str | None = None) -> Choice:
    """``choose`` for flight. Raises ConfigError where the named model and the vehicle file contradict each other."""
    chosen = choose(vehicle, name, shipped)
    if chosen.contradictions:
        raise ConfigError(
            f"--model {name}: is of another fan than the vehicle file "
            f"({'; '.join(chosen.contradictions)}); use this vehicle's own model, or --model none"
        )
    return chosen
