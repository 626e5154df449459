"""Public tables of others: their data read from a clone, their protocol, our rows beside theirs."""
