"""``replay vehicle``: what a hover in a log says about the vehicle file."""
