"""What the pilot sees during and after a flight."""
