"""Simulated lives as bags."""
