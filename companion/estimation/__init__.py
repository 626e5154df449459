"""From samples to what is known of the surroundings."""
