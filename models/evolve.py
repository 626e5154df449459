"""``dataclasses.replace`` for records that change at every message: a copy of the dictionary instead of a call of init.

The record must be a frozen dataclass without slots whose fields are all arguments of its constructor. Names are checked
by the type checker, which sees ``dataclasses.replace``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dataclasses import replace
else:

    def replace(record: Any, /, **changes: Any) -> Any:
        """The same record with these fields changed; the record itself stays as it was."""
        new = object.__new__(record.__class__)
        fields = new.__dict__
        fields.update(record.__dict__)
        fields.update(changes)
        return new


__all__ = ["replace"]
