"""What ``step`` remembers between samples, one record a topic, and what it says about a decision."""
