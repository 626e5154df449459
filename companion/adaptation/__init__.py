"""A model proves itself in flight: sizes of named effects, measured while flying, and what follows for the offsets."""
