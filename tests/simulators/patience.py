"""How long a test waits for what comes sooner or later."""

HANG_S = 300.0
"""Nothing takes so long but what hangs, however busy the machine."""
