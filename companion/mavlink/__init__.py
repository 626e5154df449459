"""Messages: the endpoint, the wire, and samples in SI."""

BAUD = 460800
"""Of a serial port, unless another is asked for: 115200 is too slow for the streams of a flight (docs/install.md)."""
AUTOPILOT_COMPONENT = 1
"""MAV_COMP_ID_AUTOPILOT1."""
OWN_COMPONENT = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER."""
NO_AUTOPILOT = 8
"""MAV_AUTOPILOT_INVALID: the sender is no flight controller."""
