# SPDX-License-Identifier: Apache-2.0
"""Ordinary motion of the simulated actuator for tests."""

import numpy as np

from ema_core.commands import Command
from ema_core.description import ActuatorDescription
from ema_core.faults import fault_vector
from ema_core.telemetry import Telemetry
from ema_monitor.windows.stretches import StretchTrigger
from ema_monitor.windows.trigger import ANY_MOTION, TriggerSettings
from ema_monitor.windows.window import Window
from ema_sim.actuator import SimulatedActuator

from .streams import blocks, only

FLAP = ActuatorDescription()
H = FLAP.sample_period
SETTINGS = TriggerSettings(windows=ANY_MOTION)


def moves(seconds: float, seed: int = 3, rate: float = 0.3) -> np.ndarray:
    """Return random smooth moves with dwells [rad]."""
    return Command("moves", amplitude=0.008, rate=rate, duration=seconds, seed=seed).sample(H)


def moved(command: np.ndarray, *, load: float = 0.3, **faults: float) -> Telemetry:
    """Return telemetry of an actuator that follows a command."""
    actuator = SimulatedActuator()
    actuator.faults = fault_vector(faults)
    actuator.causes = {"load_torque": load}
    return actuator.advance(command)


def stretches_of(telemetry: Telemetry, size: int = 1000) -> list[Window]:
    """Return the stretches in telemetry that is received in blocks of ``size`` samples."""
    trigger = StretchTrigger(FLAP.parameters, SETTINGS)
    events = [event for block in blocks(telemetry, size) for event in trigger.feed(block)]
    return only(Window, events)
