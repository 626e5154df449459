"""ESC_INFO (290) and ESC_STATUS (291), which pymavlink 2.4.50 has in no dialect.

Field order on the wire, sizes and checksum extras follow from the fields in common.xml by MAVLink's own rules (fields
by size, the extra from names and types); ``tests/companion/test_messages_esc.py`` derives them again with pymavlink's
generator.
"""

from __future__ import annotations

import struct
from typing import NamedTuple


class EscMessage(NamedTuple):
    """One message as on the wire, fields in wire order; the attributes are named as in pymavlink's message classes."""

    id: int
    msgname: str
    crc_extra: int
    unpacker: struct.Struct
    ordered_fieldnames: tuple[str, ...]


ESC_INFO = EscMessage(
    290,
    "ESC_INFO",
    251,
    struct.Struct("<Q4IH4H4hBBBB"),
    (
        "time_usec",
        "error_count",
        "counter",
        "failure_flags",
        "temperature",
        "index",
        "count",
        "connection_type",
        "info",
    ),
)
ESC_STATUS = EscMessage(
    291,
    "ESC_STATUS",
    10,
    struct.Struct("<Q4i4f4fB"),
    ("time_usec", "rpm", "voltage", "current", "index"),
)
BY_ID = {ESC_INFO.id: ESC_INFO, ESC_STATUS.id: ESC_STATUS}
"""``index`` is the first of the four ESCs, from 0; temperature in cdegC; rpm negative in reverse."""
