"""Runs of the reference kernels that keep every state."""

from collections.abc import Callable

import numpy as np

from ema_core.acquisition import Acquisition
from ema_core.dynamics import current_sampling, lag_factor
from ema_core.parameters import (
    ControlConstants,
    MechanicalConstants,
    MotorConstants,
    PlantConstants,
)
from ema_sim.effects import NO_EFFECTS, NO_PAUSES
from ema_sim.motor import windings
from ema_sim.reference import DT, State, Stepping, advance_sample

Signal = float | Callable[[float], float]

MEAN = current_sampling(Acquisition(), 1, DT)
"""A sample of the current is the sum over its steps."""

_ROW = [(name, float) for name in State._fields]


def step(
    control: ControlConstants,
    motor: MotorConstants,
    mechanics: MechanicalConstants,
    state: State,
    command: float,
    disturbance: float,
    load: float,
    dt: float,
    lag: float,
) -> State:
    """State after a sample of one step; what is not held in it is found anew."""
    plant = control, motor, mechanics, windings(motor), NO_EFFECTS, NO_PAUSES
    held = np.array([disturbance])
    rest = held, 0, Stepping(1, 1, dt, lag, MEAN), 0.0
    return advance_sample(*plant, state, command, 0.0, load, 0.0, *rest)[0]


def run(
    plant: PlantConstants,
    state: State,
    steps: int,
    *,
    command: Signal = 0.0,
    load: Signal = 0.0,
    dt: float = DT,
) -> np.recarray:
    """States after 0, 1, ... `steps` steps, `(steps + 1,)` with a field per state.

    Command [rad] and load [N.m] are constants or functions of time [s].
    """
    lag = lag_factor(dt)
    command_at = command if callable(command) else lambda _: float(command)
    load_at = load if callable(load) else lambda _: float(load)
    states = [state]
    for n in range(steps):
        state = step(*plant, state, command_at(n * dt), 0.0, load_at(n * dt), dt, lag)
        states.append(state)
    return np.array(states, dtype=_ROW).view(np.recarray)


def locked(plant: PlantConstants) -> PlantConstants:
    """Hold the rotor whatever the torque."""
    return plant._replace(mechanics=plant.mechanics._replace(f_s=1e9))


def unpowered(plant: PlantConstants) -> PlantConstants:
    """Cut the tie between motor and shaft: no torque, no back-EMF."""
    return plant._replace(motor=plant.motor._replace(k_e=0.0))
