"""What an answer states of one effect, how surely, and whether that is right: what reliability counts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Statement:
    """One name that an answer states, and whether it is right (None: nothing is known)."""

    effect: str
    right: bool | None
    why: str
    probability: float | None
    q_value: float | None
    status: str
    at_bound: bool
    named: bool = True
    """False: not adopted, but the answer gives its probability."""


def statement(
    entry: Mapping[str, Any], right: bool | None, why: str = "", *, named: bool = True
) -> Statement:
    """From an entry of ``effects`` or ``rejected`` in the JSON of ``replay diagnose``."""
    parameters = entry.get("parameters", {}).values()
    return Statement(
        str(entry["name"]), right, why, number(entry.get("probability")), number(entry.get("q_value")),
        str(entry.get("status", "")), any(bool(p.get("at_bound")) for p in parameters), named,
    )  # fmt: skip


def number(value: Any) -> float | None:
    """A number of a JSON, where there is one."""
    return None if value is None else float(value)
