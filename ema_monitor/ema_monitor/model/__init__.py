"""Monitor model: a fast actuator model for estimation."""
