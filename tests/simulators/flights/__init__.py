"""An independent flight simulator that records tlogs with undeclared effects, to test ``replay diagnose``.

It shares no formula with the effect catalogue and imports nothing of the project: its own air, bodies, sensors and
MAVLink files. Every flight is simulated; nothing is measured. ``docs/lab/diagnose-suite.md`` says what is assumed.

Layout: ``craft`` (vehicles), ``near_wall`` (declared air and its table), ``plan`` (manoeuvres), ``rotor_flow``
(momentum and blade-element theory), ``effects`` and ``unlisted`` (what is undeclared), ``power`` (battery, motors),
``pilot`` (autopilot), ``world`` (the 6-DOF loop, all flights of a batch side by side), ``recorder`` (sensors, tlog),
``oracle`` (residual before and after removing the true effect), ``scenarios`` (which flights), ``make`` (files).
``tests/benchmarks/diagnosis/flights_judge.py`` says which answers are right.
"""
