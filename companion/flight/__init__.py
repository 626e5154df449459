"""A flight: the live loop, what is due by time alone, what the pilot reads, and how a flight ends."""
