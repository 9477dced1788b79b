"""Duty of an actuator, measured from its telemetry."""
