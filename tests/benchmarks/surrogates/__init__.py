"""Surrogates of a fan: their data, their training, their sigma."""
