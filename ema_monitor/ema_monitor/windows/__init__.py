"""Windows: found in telemetry, checked, and smoothed to their informative band."""
