"""Publishing of a monitor: estimates, health, status and log."""
