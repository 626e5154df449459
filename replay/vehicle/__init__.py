"""A vehicle drafted from logs."""
