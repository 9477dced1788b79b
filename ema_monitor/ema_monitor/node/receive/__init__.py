"""Receiving part of a monitor: turns accepted messages into windows, measurements, counts."""
