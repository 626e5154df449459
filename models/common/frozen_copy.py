"""Copies of records that change at every message: of their dictionary, instead of a call of init.

It takes a fifth of the time of ``dataclasses.replace``. The record must be a frozen dataclass without slots, and its
fields must all be arguments of its constructor.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    # The type checker checks the names and types of the changes.
    from dataclasses import replace as with_changes
else:
    _new = object.__new__
    _set = object.__setattr__

    def with_changes(record: Any, /, **changes: Any) -> Any:
        """The same record with these fields changed; the record itself stays as it was. TypeError for another name."""
        # One union and one assignment: five times as fast as filling the new record's own dictionary.
        values = record.__dict__ | changes
        fields = record.__dataclass_fields__
        if len(values) != len(fields):
            values = _of_fields(record, changes)
        new = _new(record.__class__)
        _set(new, "__dict__", values)
        return new

    def _of_fields(record: Any, changes: dict[str, Any]) -> dict[str, Any]:
        """The new values without cached properties of the old ones."""
        kept = record.__dict__
        fields = record.__dataclass_fields__
        for name in changes:
            if name not in fields:
                raise TypeError(f"{record.__class__.__name__} has no field {name!r}")
        return {name: kept[name] for name in fields} | changes


__all__ = ["with_changes"]
