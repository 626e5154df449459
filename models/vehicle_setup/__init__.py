"""``models vehicle``: a vehicle file from a frame, a mass, a few lengths and the autopilot's parameters."""
