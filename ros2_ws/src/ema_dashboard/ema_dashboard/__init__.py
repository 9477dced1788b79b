"""The graph for Foxglove, and for a web page of its own."""
