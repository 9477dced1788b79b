"""Nodes as processes."""
