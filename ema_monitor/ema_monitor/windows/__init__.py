"""Extraction and checking of telemetry windows, and band limitation of residuals."""
