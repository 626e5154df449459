"""Messages: the endpoint, the wire, and samples in SI."""
