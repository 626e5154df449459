"""pymavlink's whole dialect, imported in this one place: for logs, the built-in vehicle and tests.

Flight does without it (definitions.py). pymavlink reads ``MAVLINK20`` at import and otherwise starts as MAVLink 1; its
``mavutil`` would load every dialect and flip them at run time. So the switch is set here and the module is imported
directly.
"""

from __future__ import annotations

import os
from typing import Any

os.environ["MAVLINK20"] = "1"

from pymavlink.dialects.v20 import ardupilotmega

mavlink: Any = ardupilotmega
"""The ardupilotmega dialect, a superset of common and of what PX4 sends (but for ids 290 and 291: esc_messages.py)."""
