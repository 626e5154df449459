"""Logs of users, with the oddities of the field."""
