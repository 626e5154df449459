"""``models paper``: figures and tables of Ai et al. 2020, Sensors 20(20), 5805, from this project's own data."""
