"""Measured minus modelled wrench."""
