"""Simulated robot arm: joints, their work, and its telemetry."""
