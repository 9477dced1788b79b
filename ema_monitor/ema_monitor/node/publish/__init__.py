"""What a monitor publishes: estimates, health, status and log."""
