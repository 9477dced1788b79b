"""Running of nodes as processes."""
