"""What goes wrong in a flight beside a wall, flown in lockstep against the built-in vehicle, every output checked."""
