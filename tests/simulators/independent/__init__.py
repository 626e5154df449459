"""A second flight simulator that records tlogs with undeclared effects, so that no one simulator is learnt by heart.

It shares no code and no formula with ``flights`` (the first one), with the effect catalogue or with the rest of the
project: blade-element rotors with dynamic inflow, motors as electric circuits, a cascaded geometric controller,
Runge-Kutta integration, other sensors. Everything is simulated. ``docs/lab/independent-simulator.md``
lists what is assumed and where each formula comes from.

Every physical effect acts in every flight, mostly small, as on a real vehicle; the truth is the size of each.

Layout: ``airframes`` (vehicles and their files), ``rotor`` (thrust, inflow, drag), ``surfaces`` (ground, wall,
ceiling), ``power`` (battery, ESC, motor, heat), ``weather`` (wind, gusts), ``conditions`` (what is undeclared and how
large), ``script`` (where the pilot goes), ``controller`` (autopilot), ``loads`` and ``flight`` (forces and integrator;
flights of one vehicle side by side), ``explain`` (wrench of each effect from the recorded states), ``sensors``,
``tlog``, ``cases`` (which flights), ``make`` (files). ``tests/benchmarks/diagnosis/independent_judge.py`` says which
answers are right.
"""
