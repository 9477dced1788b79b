"""Command-line interface ``ema``."""
