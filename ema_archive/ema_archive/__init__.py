"""The bags of a fleet as tables."""
