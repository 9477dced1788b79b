# SPDX-License-Identifier: Apache-2.0
"""Runs of the reference kernels that store every state, and comparison of telemetry."""

from collections.abc import Callable

import numba
import numpy as np

from ema_core.acquisition import Acquisition
from ema_core.dynamics import current_sampling, lag_factor
from ema_core.parameters import PlantConstants
from ema_core.telemetry import COLUMNS, Telemetry
from ema_sim.effects import NO_EFFECTS, NO_PAUSES
from ema_sim.motor import windings
from ema_sim.reference import DT, State, Stepping, advance_sample

Signal = float | np.ndarray | Callable[[float], float]

MEAN = current_sampling(Acquisition(), 1, DT)
"""A sample of the current is the sum over its steps."""


def run(
    plant: PlantConstants,
    state: State,
    steps: int,
    *,
    command: Signal = 0.0,
    load: Signal = 0.0,
    noise: Signal = 0.0,
    dt: float = DT,
) -> np.recarray:
    """Return states after 0, 1, ... `steps` steps, `(steps + 1,)` with a field per state.

    Command [rad], load [N.m] and noise on the reference current [A] are constants, arrays with a
    value per step, or functions of time [s].
    """
    times = dt * np.arange(steps)
    signals = _sampled(command, times), _sampled(load, times), _sampled(noise, times)
    rows = np.empty((steps + 1, len(state)))
    rows[0] = state
    stepping = Stepping(1, 1, dt, lag_factor(dt), MEAN)
    _fill(plant, (NO_EFFECTS, NO_PAUSES), stepping, state, signals, rows)
    dtype = [(name, float) for name in State._fields]
    return np.rec.fromarrays(list(rows.T), dtype=dtype)


def _sampled(signal: Signal, times: np.ndarray) -> np.ndarray:
    if callable(signal):
        return np.array([signal(t) for t in times.tolist()])
    return np.full(len(times), signal, dtype=float)


@numba.njit(error_model="numpy")
def _fill(plant, held, stepping, state, signals, rows):
    """Advance by samples of one step each; recompute quantities that the state does not hold."""
    control, motor, mechanics = plant
    phases = windings(motor)
    effects, pauses = held
    commands, loads, noise = signals
    for n in range(len(commands)):
        state, _, _ = advance_sample(
            control,
            motor,
            mechanics,
            phases,
            effects,
            pauses,
            state,
            commands[n],
            0.0,
            loads[n],
            0.0,
            noise,
            n,
            stepping,
            0.0,
        )
        for k in range(len(state)):
            rows[n + 1, k] = state[k]


def locked(plant: PlantConstants) -> PlantConstants:
    """Return the plant with a locked rotor."""
    return plant._replace(mechanics=plant.mechanics._replace(f_s=1e9))


def unpowered(plant: PlantConstants) -> PlantConstants:
    """Return the plant without a link between motor and shaft: no torque, no back-EMF."""
    return plant._replace(motor=plant.motor._replace(k_e=0.0))


def assert_same(first: Telemetry, second: Telemetry) -> None:
    """Assert that stamps, indices and values are bit-identical."""
    np.testing.assert_array_equal(first.stamps_ns, second.stamps_ns)
    assert first.first_index == second.first_index
    for column in COLUMNS:
        np.testing.assert_array_equal(getattr(first, column), getattr(second, column))
