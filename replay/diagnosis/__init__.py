"""The answer of a diagnosis: JSON, page, amended model."""
