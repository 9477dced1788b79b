"""How faults grow from test to test, and how long it takes until life ends."""
