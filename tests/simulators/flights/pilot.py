"""The autopilot: position hold with integrators, cascaded, and the mix to servo outputs. All arrays are (..., n)."""

from __future__ import annotations

import numpy as np

from .craft import EXPO, GRAVITY, PWM_MAX, PWM_MIN, VANE_NEUTRAL, VANE_RAD_PER_US, Array, Craft

# Outer loop, by world axis: sideways slower than upwards, for it goes through the attitude.
PLACE_GAIN = np.array([[1.1], [1.1], [1.4]])
SPEED_GAIN = np.array([[2.7], [2.7], [3.2]])
SPEED_I = np.array([[0.5], [0.5], [0.9]])


class Pilot:
    """One pilot per flight, side by side."""

    def __init__(self, craft: Craft, n: int, agility: Array) -> None:
        self.craft = craft
        self.agility = agility  # (n,) scales the outer loop
        self.velocity_i = np.zeros((3, n))
        self.rate_i = np.zeros((3, n))
        self.inertia = np.array(craft.inertia)[:, None]
        self.last_rates = np.zeros((3, n))
        self.d_term = np.zeros((3, n))
        self.mix = np.linalg.pinv(_effectiveness(craft)) if not craft.vane_position else None

    def outputs(
        self, dt: float, position: Array, velocity: Array, rotation: Array, rates: Array, yaw: Array,
        place: Array, speed: Array, push: Array, yaw_wanted: Array,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Rotor outputs (fans, n) and vane outputs (vanes, n), both in us as the autopilot sends them."""
        wanted_v = speed + PLACE_GAIN * self.agility * (place - position)
        wanted_v = np.clip(wanted_v, -4.0, 4.0)
        error = wanted_v - velocity
        self.velocity_i = np.clip(self.velocity_i + dt * SPEED_I * error, -3.0, 3.0)
        accel = push + SPEED_GAIN * self.agility * error + self.velocity_i
        accel[:2] = np.clip(accel[:2], -4.0, 4.0)
        accel[2] = np.clip(accel[2], -4.0, 4.0)
        lift = GRAVITY - accel[2]
        c, s = np.cos(yaw), np.sin(yaw)
        forward, right = c * accel[0] + s * accel[1], -s * accel[0] + c * accel[1]
        pitch_wanted, roll_wanted = (
            -np.arctan2(forward, lift),
            np.arctan2(right, np.hypot(lift, forward)),
        )
        pitch = np.arcsin(np.clip(-rotation[2, 0], -1.0, 1.0))
        roll = np.arctan2(rotation[2, 1], rotation[2, 2])
        turn = (yaw_wanted - yaw + np.pi) % (2.0 * np.pi) - np.pi
        wanted_rates = np.stack(
            [
                6.0 * (roll_wanted - roll),
                5.0 * (pitch_wanted - pitch),
                np.clip(2.0 * turn, -1.2, 1.2),
            ]
        )
        error = wanted_rates - rates
        gain = np.array([[16.0], [10.0], [6.0]])
        self.rate_i = np.clip(
            self.rate_i + dt * np.array([[12.0], [8.0], [4.0]]) * error, -8.0, 8.0
        )
        self.d_term += dt * 60.0 * ((rates - self.last_rates) / dt - self.d_term)
        self.last_rates = rates.copy()
        spin_up = gain * error + self.rate_i - np.array([[0.15], [0.25], [0.0]]) * self.d_term
        moment = self.inertia * np.clip(spin_up, -40.0, 40.0)
        thrust = self.craft.mass_kg * lift / np.clip(rotation[2, 2], 0.6, 1.0)
        thrust = np.clip(
            thrust, 0.3 * self.craft.mass_kg * GRAVITY, 1.5 * self.craft.mass_kg * GRAVITY
        )
        return self._mix(thrust, moment)

    def _mix(self, thrust: Array, moment: Array) -> tuple[Array, Array]:
        craft = self.craft
        if self.mix is not None:
            fans = self.mix @ np.vstack([thrust[None], moment])
            vanes = np.zeros((0, thrust.shape[0]))
        else:
            arm = craft.fan_position[0][0]
            half = np.clip(moment[1] / (2.0 * arm), -0.3 * thrust, 0.3 * thrust)
            fans = np.stack([0.5 * thrust + half, 0.5 * thrust - half])
            down = craft.vane_position[0][2]
            both, split = -moment[0] / (2.0 * down), moment[2] / (2.0 * arm)
            side = np.stack([both + split, both - split]) / (craft.vane_gain * fans)
            vanes = np.rint(VANE_NEUTRAL + np.clip(side, -0.40, 0.40) / VANE_RAD_PER_US)
        share = np.clip(fans / craft.rotors_per_fan / craft.max_rotor_thrust_n, 0.02, 1.0)
        throttle = (np.sqrt((1.0 - EXPO) ** 2 + 4.0 * EXPO * share) - (1.0 - EXPO)) / (2.0 * EXPO)
        return np.rint(PWM_MIN + (PWM_MAX - PWM_MIN) * throttle), vanes


def rotor_thrust(craft: Craft, pwm: Array) -> Array:
    """Still, free-air thrust of one rotor at the nominal voltage for an output [us]."""
    u = (pwm - PWM_MIN) / (PWM_MAX - PWM_MIN)
    return craft.max_rotor_thrust_n * ((1.0 - EXPO) * u + EXPO * u * u)


def _effectiveness(craft: Craft) -> Array:
    """Thrust and moments (4, fans) per newton of each fan: r x (0, 0, -L) and the drag torque of its rotor."""
    x, y = np.array(craft.fan_position).T[:2]
    return np.stack(
        [np.ones_like(x), -y, x, -np.array(craft.spin) * craft.cq / craft.ct * craft.radius_m]
    )
