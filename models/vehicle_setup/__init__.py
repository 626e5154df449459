"""First numbers of a vehicle: frames, typical sizes, estimates, and the text of a vehicle file."""
