"""Duty as it is flown: what is measured of it, the damage that it does, and duties to come."""
