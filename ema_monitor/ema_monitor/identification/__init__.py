"""Identification of faults: from a window to an estimate with its uncertainty."""
