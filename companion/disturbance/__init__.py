"""The disturbance: what ground, walls and adopted effects do to the vehicle now, by the model."""
