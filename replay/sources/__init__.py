"""Which of several instances each quantity of a log is read from: one rule for all of them."""
