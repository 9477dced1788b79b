# SPDX-License-Identifier: Apache-2.0
"""A second actuator model, independent of ``ema_sim``. The monitor is not tuned on it.

It shares the definitions of parameters, telemetry, faults and hidden causes with the simulator.
Its integrator, inverter, friction and sensors are different.
"""
