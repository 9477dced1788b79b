"""Work of a monitor: estimates, prognoses, and answers to calls, each in a separate thread."""
