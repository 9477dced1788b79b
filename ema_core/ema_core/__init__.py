"""Numerics and data that simulator and monitor share."""

__version__ = "0.2.0"
