"""Archive: results from the bags of a fleet, stored as tables."""
