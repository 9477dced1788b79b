"""Fault growth: measurement, tracking and extrapolation."""
