"""Required performances, and when they fail."""
