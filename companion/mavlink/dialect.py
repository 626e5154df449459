"""pymavlink's dialect, imported in this one place.

pymavlink reads ``MAVLINK20`` at import and otherwise starts as MAVLink 1; its ``mavutil`` would load every dialect and
flip them at run time. So the switch is set here and the module is imported directly.
"""

from __future__ import annotations

import os
from typing import Any

os.environ["MAVLINK20"] = "1"

from pymavlink.dialects.v20 import ardupilotmega

from companion.mavlink.esc_messages import BY_ID

mavlink: Any = ardupilotmega
"""The ardupilotmega dialect, a superset of common and of what PX4 sends (but for ids 290 and 291: esc_messages.py)."""

MESSAGES: dict[int, Any] = {
    number: kind for number, kind in mavlink.mavlink_map.items() if number >= 0
} | BY_ID
"""Every message by id: classes of pymavlink and the two that it lacks. Its marker of bad data has a negative id."""
ID_OF = {kind.msgname: number for number, kind in MESSAGES.items()}
