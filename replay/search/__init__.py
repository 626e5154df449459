"""Which effects carry a residual."""
