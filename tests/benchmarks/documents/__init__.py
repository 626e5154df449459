"""What the project says of itself: pages, guide, wheel."""
