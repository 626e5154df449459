"""What makes a surrogate from a data set."""
