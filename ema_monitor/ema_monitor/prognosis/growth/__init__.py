"""Growth of the faults: measured, tracked and extrapolated."""
