"""What the air does: data, training, surrogates, effects. Numerics only; no MAVLink."""
