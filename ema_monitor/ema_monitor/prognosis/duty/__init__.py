"""Duty of a unit: its measurement, the damage it causes, and future duties."""
