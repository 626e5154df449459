"""Messages: the endpoint, the wire, and samples in SI."""

BAUD = 460800
"""Of a serial port, unless another is asked for: 115200 is too slow for the streams of a flight (docs/install.md)."""
