"""A table of a TOML file as a frozen dataclass: keys, types and bounds are those of its fields.

A bound stands beside the type of a field: ``mass_kg: Annotated[float, above(0.0, 1e4)]``. Whole numbers without a bound
are at least 1. A field with a default may be left out, unless the dataclass names it in ``REQUIRED``.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Collection, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from difflib import get_close_matches
from types import UnionType
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

from models.common.errors import ConfigError

Record = TypeVar("Record")


@dataclass(frozen=True)
class Bounds:
    """Numbers from ``low`` to ``high``; ``above``: ``low`` itself is not one of them."""

    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    finite: bool = True

    def words(self) -> str:
        """The bounds for a person."""
        if self.above:
            bound = f"above {self.low:g}"
        else:
            bound = f"at least {self.low:g}"
        return bound + (f" and at most {self.high:g}" if math.isfinite(self.high) else "")


def above(low: float, high: float = math.inf) -> Bounds:
    """Numbers above ``low``, up to ``high``."""
    return Bounds(low, high, above=True)


@dataclass(frozen=True)
class Options:
    """Texts that are allowed, each with what it stands for."""

    meaning: Mapping[str, Any]


class Table:
    """``values`` of the file ``what`` below the keys ``prefix``; ``known``: its keys, to tell misspelt ones."""

    def __init__(
        self, values: Mapping[str, Any], what: str, prefix: str = "", known: Collection[str] = ()
    ) -> None:
        self._values = values
        self._what = what
        self._prefix = prefix
        self._known = known

    @classmethod
    def of(cls, text: str, what: str, known: Collection[str] = ()) -> Table:
        """The whole of a TOML text."""
        try:
            return cls(tomllib.loads(text), what, known=known)
        except tomllib.TOMLDecodeError as error:
            raise ConfigError(f"{what}: not valid TOML: {error}") from None

    def fail(self, key: str, problem: str) -> ConfigError:
        """The error about one key."""
        return ConfigError(f"{self._what}: key '{self._prefix}{key}' {problem}")

    def read(self, kind: type[Record], names: Mapping[str, str] | None = None) -> Record:
        """The table as ``kind``; ``names``: fields that have another key. Raises ConfigError naming the key.

        A record that has ``problem()`` says by it, as key and words, what is wrong with its values together.
        """
        keys = {f.name: (names or {}).get(f.name, f.name) for f in fields(kind)}  # type: ignore[arg-type]
        hints = get_type_hints(kind, include_extras=True)
        required = getattr(kind, "REQUIRED", ())
        taken: dict[str, Any] = {}
        for f in fields(kind):  # type: ignore[arg-type]
            key = keys[f.name]
            if key in self._values:
                taken[f.name] = self._taken(key, self._values[key], hints[f.name], Bounds())
            elif (f.default is MISSING and f.default_factory is MISSING) or f.name in required:
                raise self._missing(key)
        self._refuse_others(keys.values())
        record = kind(**taken)
        if hasattr(record, "problem"):
            problem = record.problem()
        else:
            problem = None
        if problem is not None:
            raise self.fail(*problem)
        return record

    def _missing(self, key: str) -> ConfigError:
        # A key spelt otherwise is the usual reason: name it too.
        meant = get_close_matches(key, [k for k in self._values if k not in self._known], 1, 0.5)
        return self.fail(
            key, f"is missing; '{self._prefix}{meant[0]}' is not known" if meant else "is missing"
        )

    def _refuse_others(self, keys: Collection[str]) -> None:
        for key in self._values:
            if key not in keys:
                meant = get_close_matches(key, sorted({*keys, *self._known}), 1, 0.6)
                raise self.fail(
                    key, f"is not known; did you mean '{meant[0]}'?" if meant else "is not known"
                )

    def _taken(self, key: str, value: Any, hint: Any, bound: Any) -> Any:
        origin = get_origin(hint)
        args = get_args(hint)
        if origin is Annotated:
            return self._taken(key, value, args[0], args[1])
        if origin is UnionType:
            return self._taken(key, value, args[0], bound)
        if isinstance(bound, Options) or hint is str:
            return self._text(key, value, bound)
        if is_dataclass(hint):
            if not isinstance(value, dict):
                raise self.fail(key, "must be a table")
            return Table(value, self._what, f"{self._prefix}{key}.", self._known).read(hint)  # type: ignore[arg-type]
        if origin is not tuple:
            return self._number(key, value, bound, whole=hint is int)
        tables = is_dataclass(args[0])
        if tables and not (
            isinstance(value, list) and value and all(isinstance(v, dict) for v in value)
        ):
            raise self.fail(key, "must be one or more tables")
        if args[-1] is Ellipsis:
            count = None
        else:
            count = len(args)
        if not isinstance(value, list) or count not in (None, len(value)):
            if count is None:
                words = "a list"
            else:
                words = f"{'two' if count == 2 else 'three'} numbers"
            raise self.fail(key, f"must be {words}, not {value!r}")
        return tuple(
            self._taken(f"{key}[{i}]", v, args[0], bound) for i, v in enumerate(value, int(tables))
        )

    def _text(self, key: str, value: Any, bound: Any) -> Any:
        if isinstance(bound, Options):
            meaning = bound.meaning
        else:
            meaning = None
        if not isinstance(value, str) or (meaning is not None and value not in meaning):
            if meaning is None:
                expected = "text"
            else:
                expected = f"one of {', '.join(meaning)}"
            raise self.fail(key, f"must be {expected}, not {value!r}")
        if meaning is None:
            return value
        return meaning[value]

    def _number(self, key: str, value: Any, bound: Bounds, *, whole: bool = False) -> int | float:
        usual = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
        if not usual or math.isnan(value) or (bound.finite and math.isinf(value)):
            raise self.fail(
                key, f"must be a {'whole' if whole else 'finite'} number, not {value!r}"
            )
        if whole and bound.low == -math.inf:
            bound = Bounds(1.0)
        if not bound.low <= value <= bound.high or (bound.above and value == bound.low):
            raise self.fail(key, f"must be {bound.words()}, not {value:g}")
        if whole:
            return int(value)
        return float(value)
