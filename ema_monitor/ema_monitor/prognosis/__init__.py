"""Fault growth from test to test, and prediction of the remaining useful life."""
