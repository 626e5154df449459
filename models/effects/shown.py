"""How people see an effect."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from models.common.frames import Array
from models.effects.context import Context


@dataclass(frozen=True)
class Drawn:
    """How a record shows an effect: force or moment in ``direction`` (6,) or (n, 6) over a quantity ``values`` (n,)."""

    label: str
    """Of the quantity, with its unit."""
    values: Array
    force_label: str
    direction: Array


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A number that is said in place of one parameter, in the words and units of people.

    A model directory keeps the parameter: the force that it stands for is the same.
    """

    instead_of: str
    name: str
    unit: str
    of: Callable[[Context, Mapping[str, Array]], Array] | None = None
    """Of draws (m,) of every parameter, draws (m,) of the quantity; None: the parameter itself, by another name."""


@dataclass(frozen=True, kw_only=True)
class Shown:
    """How people see an effect: its picture, its size as a pilot says it, its numbers, and a remark."""

    drawn: Callable[[Context, str], Drawn] | None = None
    """The picture that shows it on one axis; None: over time."""
    in_words: Callable[[Context, Mapping[str, float]], str] | None = None
    """Its size on a record, by its numbers as they are said; None: by these numbers."""
    push: Callable[[Context, Mapping[str, float]], str] | None = None
    """Its force on a record, by its parameters as a model directory keeps them; None: nothing is said of it. A product
    of numbers that are said is no force: each is a mean of its own."""
    quantities: tuple[Quantity, ...] = ()
    """Numbers that are said in place of parameters; all other parameters are said as they are."""
    log_weight: Callable[[Context, Mapping[str, Array]], Array] | None = None
    """Of draws (m,) of every parameter, log weights (m,): prior of the quantities over that of the parameters."""
    remark: Callable[[Mapping[str, bool]], str | None] | None = None
    """By which parameters the flights determine."""
