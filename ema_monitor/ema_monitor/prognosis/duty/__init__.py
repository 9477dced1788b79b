"""Flown duty: its measurement, the damage it causes, and future duties."""
