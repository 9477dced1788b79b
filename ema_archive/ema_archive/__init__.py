"""Archive: estimates, health and life from the bags of a fleet, stored as tables."""
