"""The built-in vehicle, its own process, real MAVLink over loopback UDP."""
