"""Windows: extracted from telemetry, checked, and smoothed to their informative band."""
