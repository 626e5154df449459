"""Every number that decides which effects are named, how surely, and what is left without a name.

How each is used stands in docs/search.md under the same capitals; how each was chosen in docs/lab/rules.md.
"""

from __future__ import annotations

# Priors of the catalogue and of what has no name

KNOWN = 0.02
"""Odds of an unknown force that goes with a channel, where the catalogue has an effect that does."""
TRIM = 0.5
"""Standard deviation of the trims that every vehicle has, in hundredths of the weight (times the lever, for moments).

Of level forces that is an accelerometer mounted 0.3 degrees askew.
"""
LIFT_TRIM = 0.25
"""The same of lift: a thrust coefficient that is 0.25 % off. What is more has a name."""
CLOCK_SD_S = 0.035
"""Standard deviation of what is left of the rotor speeds' delay after it was estimated by cross-correlation [s]."""
OFF_CENTRE = 0.15
"""Standard deviation of the accelerometer's place along every axis, as a share of the farthest fan's arm."""
USUAL_DRAG = 0.25
"""Drag of open rotors on the own motion, as a share of momentum theory's: what a velocity that is late shows by."""
KINEMATIC_SD_M_S2 = 0.05
"""Standard deviation with which velocity and attitude show the accelerometer's mean offset [m/s^2]: 0.3 deg of tilt."""
FORM_PRIOR = 0.25
"""Prior standard deviation of an effect's model-form error, as a share of its typical size."""
FORM_LEAST = 0.1
"""Share by which an effect's size has to vary for its form to matter."""
AT_SHAPE_SPREAD = 0.15
"""Share by which a length may differ from the one at which it was linearised (standard deviation)."""
AMPLITUDE = 3.0
"""Prior standard deviation of a curve, in hundredths of the weight."""
ODDS = 2e-4
REACTION_ODDS = 1e-5
"""Prior odds of a curve over one channel on one axis: rarer than every effect, as there are a hundred such curves; and
of one over a channel that responds to disturbances."""
SHORTEST_S = 8.0
"""Between a beginning and an end: what is shorter is a gust, or the wake of another vehicle."""
CHANCE = 0.1
"""Probability that what is there begins in this flight, and as much that it ends."""
MOST_TIMES = 400
"""Times that are looked at, evenly over the flight."""

# Evidence and noise

TRUST = 0.5
"""Power of the likelihood: neither noise nor effects are quite of the assumed form (Miller & Dunson 2019)."""
FLOOR = 0.2
"""Smallest RMS of the fast and of the slow part of the noise, in hundredths of the weight: no model is better."""
LOUDEST = 5.0
GUST_S = 1.0
"""Prior standard deviation of the noise's, in hundredths of the weight: no air is as unsteady; and how long gusts last
[s]: height over speed (Dryden spectrum, MIL-F-8785C), 5 m over 5 m/s."""

# What deserves a name

FORM_LEFT = 0.06
"""RMS that an effect leaves by its model-form error, as a share of its own."""
CURVE_FORM = 1.2
"""What a free curve may leave by its form, as a share of its own: it has no mean, and what is beside it may be that."""
UNEXPLAINED_S = 2.0
"""What is left is averaged over this time before it counts as acting unexplained [s]."""
YAW = 0.25
"""A yaw moment counts in this share of the weight times the lever. Rotors turn a vehicle by differences of their
torques, and all torques together are 0.04 to 0.13 of it (ten vehicles whose thrust and torque are declared)."""
OWN = 0.75
"""Smallest minimum unique contribution of a named term, in hundredths of the weight: no model is better than that."""
HOPELESS = 0.8
"""How far a term has to stand out to be weighed beside a set: 1 is just enough to be named."""
USUAL = 2.0
USUAL_TRIM = 1.0
"""Coefficients and trims that take over stay within so many standard deviations of their prior."""
SOFT = 0.02
"""Width of the threshold of attention, as a share of it: a size on the threshold must not decide by its last digits."""
CANCEL = 2.6
CANCEL_COST = 40.0
CANCEL_FREE = 2.0
"""Terms (root of the sum of squares) may exceed what they remove together by this factor; each more costs so much.

What is below ``CANCEL_FREE`` hundredths of the weight does not count.
"""
SMALL = 0.1
"""Share of the energy of an axis, in a part of a flight, below which an effect may be too small for a name."""

# Which sets are equal, and who stands in whose place

MARGIN = 4.0
"""Sets as likely as the best but for this much (log) count as equal."""
NAMED = 1.0
"""The same of sets that lack a term of the best: a name is stated from odds of e to one on."""
LIKELY = 0.5
"""Whatever is less probable, an alias in its place included, is no name."""
ALIAS_NATS = 9.0
"""Sets less likely by this much (log) than the best are no alternative."""
SURE = 0.995
"""No more than this is claimed: models are wrong more often than the probabilities inside a model say."""
NEGLIGIBLE = 12.0
"""Sets less likely by this much (log) than the best have no weight."""
NO_MEMBER = 0.05
MOST_MEMBERS = 3
"""An effect that is less probable than that in another's place is told from it; so many members are shown."""

# Held-out time

HELD_OUT = 2.0
"""A set that leaves this much more energy of held-out time than another is not the answer, however likely it is."""
NEAR = 30.0
RIVALS = 6
"""Sets that are compared so: less likely than the best by no more than this (log), and how many."""
WORSE_SHARE = 0.005
"""Share of the residual's energy by which an effect may make held-out time worse: noise, where it is hardly excited."""
CARRIES = 0.25
"""An effect carries an axis where it is this strong beside its strongest axis, in hundredths of the weight."""
CONFIRM_SHARE = 0.01
"""Smallest share of the energy that an effect has to remove from a flight that confirms it."""

# Sizes

BOUND_SHARE = 0.01
"""Distance to a bound, as a share of the range, within which a coefficient stands at it."""
LEARNT = 0.7
"""Posterior over prior standard deviation above which a flight has said nothing about a coefficient."""
FEWEST_WITHIN = 0.05
"""Share of draws within all bounds below which draws are moved to the bounds, and not thrown away."""
LEAST_SHOWN = 0.1
"""Smallest r^2 that an interval is widened by: below, nothing is known of the size."""

# What remains without a name

FORCE_LIMIT = 2.0
MOMENT_LIMIT = 2.5
"""RMS of the remainder, in hundredths of the weight (times the lever), up to which a flight counts as explained.

Of forces all below 2 Hz counts, of moments what is slow: small vehicles tremble. Broadband unsteadiness of the air and
the declared model's own error leave about one hundredth; of 45 measured flights that are explained, 1.9 of a force and
2.2 of a moment at most.
"""
SWING_LIMIT = 1.5
SWING_SHARE = 0.8
"""RMS of a moment that swings at one frequency, in hundredths of the weight times the lever, up to which a flight
counts as explained; and the share of the moment's energy that makes it one frequency. Neither unsteady air nor the
error of a law has one.
"""
LOUD = 1.5
"""Intervals are given where the remainder exceeds the limit by this factor."""
SUDDEN = 5.0
SUDDEN_S = 0.5
"""Short disturbances are reported, too: so many times what is usual in the flight, for so long in all [s]."""
LEVEL_LEFT = 0.4
LIFT_LEFT = 1.0
MOMENT_LEFT = 2.0
"""Mean of the remainder beside a surface, in hundredths of the weight (times the lever), up to which it is explained.

0.4 of a level force tilts the vehicle by 0.23 degrees.
"""
LEAST_TURN_RAD = 0.5
"""Range of headings from which on a force may go with them."""
CLOSEST = 0.02
"""Smallest distance of two knots, as a share of the channel's range."""
