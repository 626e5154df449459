"""The flight program: MAVLink in, offset commands out."""
