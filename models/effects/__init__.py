"""The catalogue: one missing effect a file."""
