"""What the tilt lacks of what was asked for: moments of the air that the attitude loop has not trimmed out yet.

Air from the front turns a vehicle that starts or stops. A slow attitude loop trims that out within seconds. Until then
the tilt is another than was sent. A disturbance observer (Chen, Yang, Guo & Li 2016, IEEE Transactions on Industrial
Electronics 63, 1083) sees it within its time T:

    T d' = (sent behind the lags of the attitude loop - tilt) - d

The slow part d is added to what is sent next. All are accelerations [m/s^2], north and east. Where the lags are true,
nothing comes back of what is sent, and the loop of the hold is as stable as without it.
"""

from __future__ import annotations

from typing import NamedTuple

from companion.control.attitude_lag import AT_REST, Lags, answered
from companion.estimation.vectors import Level, clipped, lagged

SLOW_S = 1.2
"""T. With 0.5 s a loop that answers 1.4 times too strongly and 0.1 s late swings (docs/lab/hold.md)."""
_MOST_M_S2 = 0.6
"""3.5 degrees of tilt: more is a vehicle that is held, or does not listen."""


class TiltDeficit(NamedTuple):
    """What was sent, behind the lags, and what the tilt lacks of it."""

    sent: Lags = AT_REST
    lacking: Level = (0.0, 0.0)


def start_deficit(tilt: Level) -> TiltDeficit:
    """Nothing is missing yet: the tilt that there is counts as sent."""
    return TiltDeficit(sent=(tilt, tilt, tilt))


def watch_tilt(deficit: TiltDeficit, tilt: Level, dt_s: float) -> TiltDeficit:
    """One measured tilt more, ``dt_s`` after the last."""
    expected_n, expected_e = deficit.sent[2]
    now = (expected_n - tilt[0], expected_e - tilt[1])
    north, east = lagged(deficit.lacking, now, min(dt_s / SLOW_S, 1.0))
    return deficit._replace(lacking=(clipped(north, _MOST_M_S2), clipped(east, _MOST_M_S2)))


def sent(deficit: TiltDeficit, acceleration: Level, dt_s: float, lag_s: float) -> TiltDeficit:
    """A setpoint more, ``dt_s`` after the last; ``lag_s`` of the attitude loop."""
    return deficit._replace(sent=answered(deficit.sent, acceleration, dt_s, lag_s))
