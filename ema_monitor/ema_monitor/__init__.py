"""Fault identification and prognosis for an electromechanical actuator, and its node."""
