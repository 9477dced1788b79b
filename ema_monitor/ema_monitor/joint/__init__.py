"""Comparison of any machine with its own healthy records, by inverse dynamics."""
