"""Reading of bags for the commands."""
