"""Fly by a controller of one's own: the companion forwards its setpoints with the offset added.

companion --connect udp:0.0.0.0:14550 --vehicle my.toml --setpoint udpin:127.0.0.1:14560
python docs/examples/upstream_controller.py udpout:127.0.0.1:14560 0.5 60

The last two are the thrust that hovers (0 to 1) and seconds. It holds the place and the heading that the vehicle has
when its mode becomes GUIDED or OFFBOARD, by position and speed, with at most 5 degrees of tilt.
"""

import math
import sys
import time

from pymavlink import mavutil
from pymavlink.quaternion import QuaternionBase

FLOWN_FROM_HERE = ("GUIDED", "OFFBOARD")
MOST_RAD = math.radians(5.0)
STIFFNESS = 1.0
"""Acceleration [m/s^2] for a metre off."""
DAMPING = 1.5
"""Acceleration for a m/s."""
GRAVITY = 9.81
IGNORE_RATES = 0b111
HEARD = ["ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED"]


def tilt(acceleration: float) -> float:
    """The angle [rad] that accelerates a hovering vehicle sideways."""
    return max(-MOST_RAD, min(MOST_RAD, acceleration / GRAVITY))


def heading_of(attitude) -> float:
    """Yaw [rad] of either message of the attitude."""
    if attitude.get_type() == "ATTITUDE":
        return attitude.yaw
    q = [attitude.q1, attitude.q2, attitude.q3, attitude.q4]
    return QuaternionBase(q).euler[2]


def command(place, home, yaw, hover):
    """Roll and pitch [rad], and thrust (0 to 1), towards ``home``: x, y, z."""
    north = STIFFNESS * (home[0] - place.x) - DAMPING * place.vx
    east = STIFFNESS * (home[1] - place.y) - DAMPING * place.vy
    down = STIFFNESS * (home[2] - place.z) - DAMPING * place.vz
    forward = north * math.cos(yaw) + east * math.sin(yaw)
    right = east * math.cos(yaw) - north * math.sin(yaw)
    thrust = hover * (1.0 - down / GRAVITY)
    return tilt(right), -tilt(forward), max(0.0, min(1.0, thrust))


if len(sys.argv) < 4:
    sys.exit(__doc__)
endpoint = sys.argv[1]
hover, seconds = map(float, sys.argv[2:])
link = mavutil.mavlink_connection(endpoint, source_system=255, source_component=190)
own = (mavutil.mavlink.MAV_TYPE_GCS, mavutil.mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4)
yaw = None
home = None
sent = 0
end = time.monotonic() + seconds
while time.monotonic() < end:
    # The first message tells the companion where we are; from then on it sends us what the vehicle says.
    link.mav.heartbeat_send(*own)
    message = link.recv_match(type=HEARD, blocking=True, timeout=0.1)
    if message is None:
        continue
    if message.get_type() != "LOCAL_POSITION_NED":
        yaw = heading_of(message)
    elif yaw is not None:
        if home is None or link.flightmode not in FLOWN_FROM_HERE:
            home = (message.x, message.y, message.z)
            heading = yaw
        roll, pitch, thrust = command(message, home, yaw, hover)
        q = list(QuaternionBase([roll, pitch, heading]).q)
        link.mav.set_attitude_target_send(
            message.time_boot_ms, 1, 1, IGNORE_RATES, q, 0.0, 0.0, 0.0, thrust
        )
        sent += 1
print(f"{sent} setpoints sent")
