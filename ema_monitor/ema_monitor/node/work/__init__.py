"""What a monitor works out: estimates, prognoses, and answers to calls, each in its thread."""
