"""What the flight program promises of everything it sends, checked on what it heard and what it sent."""
