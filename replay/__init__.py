"""Recorded flights through the same pipeline, and the loop closed with measured data."""
