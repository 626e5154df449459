"""The vehicle files that ship: the paper's tandem (the default) and a 4-fan quadrotor."""

from __future__ import annotations

from argparse import ArgumentTypeError
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from models.vehicle import Vehicle

_HERE = Path(__file__).parent
TANDEM = _HERE / "tandem.toml"
QUAD = _HERE / "quad.toml"
SHIPPED = {"tandem": TANDEM, "quad": QUAD}


def vehicle_path(text: str) -> Path:
    """The value of ``--vehicle``, for argparse: a file, or the name of one that ships.

    A word that is neither is refused with the names that are.
    """
    path = Path(text)
    if path.exists():
        return path
    if text not in SHIPPED and path.name == text and not path.suffix:
        raise ArgumentTypeError(
            f"{text}: there is no such file, and no vehicle of this name ships; those that do: "
            f"{', '.join(sorted(SHIPPED))}"
        )
    return SHIPPED.get(text, path)


def chosen_vehicle(path: Path | str | None) -> Vehicle:
    """The vehicle of a file, or of the name of one that ships; the paper's tandem without either."""
    # Imported here so that --help, which names the files, answers at once.
    from models.vehicle import load_vehicle

    if path is None:
        return load_vehicle(TANDEM)
    if not Path(path).exists():
        path = SHIPPED.get(str(path), path)
    return load_vehicle(path)


def default_vehicle() -> Vehicle:
    """The paper's tandem coaxial ducted fan."""
    return chosen_vehicle(TANDEM)
