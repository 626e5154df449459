"""``replay export``: a log as a table for other tools."""
