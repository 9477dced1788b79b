"""Performance requirements and prediction of their failure."""
