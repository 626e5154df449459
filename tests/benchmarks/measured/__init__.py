"""Measured flights: what is known of each (``flights.toml``), and whether an answer agrees with it."""
