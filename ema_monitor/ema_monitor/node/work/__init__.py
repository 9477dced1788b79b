"""Working part of a monitor: estimates, prognoses and service calls in separate threads."""
