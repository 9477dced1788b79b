"""The ema command."""
