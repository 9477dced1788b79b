"""Calibration: a model of the individual unit, fitted to healthy windows and stored."""
