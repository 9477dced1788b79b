"""From a window to an estimate of the faults, with its uncertainty."""
