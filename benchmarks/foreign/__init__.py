# SPDX-License-Identifier: Apache-2.0
"""A second actuator, written independently of ``ema_sim``: nothing of the monitor is tuned on it.

It shares with the simulator the definitions of parameters, telemetry, faults and hidden causes, and
no equation solver: another integrator, another inverter, another friction, other sensors.
"""
