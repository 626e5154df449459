"""Log files as flights on one boot clock."""
