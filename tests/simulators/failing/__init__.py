"""Multirotors that lose a motor, or something else, in flight: a closed loop of its own.

It shares no physics with the models: rigid body, rotors with a lag, a battery, wind, a ground and a wall, and a cascade
of position, speed, attitude and rate loops with a mixer that saturates.
"""
