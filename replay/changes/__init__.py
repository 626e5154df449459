"""What changed on a vehicle since flights that were good."""
