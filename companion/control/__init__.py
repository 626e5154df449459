"""From what is known to a setpoint: hold, disturbance, offsets."""
