"""``replay info``: what is in a log and what it can answer."""
