"""Reading of bags by the commands."""
