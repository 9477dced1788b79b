"""What is measured on the responses of chapter 4."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.description import SAMPLE_PERIOD
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.residual import band_limited, rms
from ema_study.responses import COMMANDS, times

AMPLITUDE: Final = COMMANDS["chirp"].amplitude
"""Of the chirp [rad]."""

STEP_START: Final = COMMANDS["step"].start_time
"""When the step comes [s]."""

START_S: Final = 0.05
"""How long the start of the response to a step is taken to last [s]."""

STRETCH_S: Final = 0.1
"""Over how long currents are compared [s]."""

_STEADY_S = 0.1
_RIPPLE_S = 5e-3
_STANDSTILL = 1.0
_ALIKE = 1e-6


def steady(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the last tenth of a second."""
    return values[-round(_STEADY_S / SAMPLE_PERIOD) :]


def rise_time(response: Telemetry) -> float:
    """Return how long after the step the speed passes 1 - 1/e of its steady mean [s]."""
    reached = (1.0 - np.exp(-1.0)) * steady(response.speed).mean()
    after = int(np.argmax(response.speed >= reached))
    before, beyond = response.speed[after - 1 : after + 1]
    place = after - 1 + (reached - before) / (beyond - before)
    return float(SAMPLE_PERIOD * place - STEP_START)


def ripple(values: NDArray[np.float64]) -> float:
    """Return the rms of what a moving mean of 5 ms leaves of a signal, in its unit."""
    n = round(_RIPPLE_S / SAMPLE_PERIOD) | 1
    middle = values[n // 2 : len(values) - n // 2]
    return rms(middle - np.convolve(values, np.full(n, 1.0 / n), mode="valid"))


def lags(nominal: Telemetry, faulty: Telemetry) -> NDArray[np.float64]:
    """Return by what share of the nominal position a rising position falls short of it [-].

    Where the nominal one has not moved yet, there is nothing to fall short of.
    """
    moved = nominal.position > 0.0
    short = np.zeros(len(nominal))
    short[moved] = 1.0 - faulty.position[moved] / nominal.position[moved]
    return short


def start_and_rest(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the first 50 ms behind the step, and what comes after them."""
    first, behind = (round(t / SAMPLE_PERIOD) for t in (STEP_START, STEP_START + START_S))
    return values[first:behind], values[behind:]


def standstill(response: Telemetry) -> float:
    """Return how long the motor is slower than 1 rad/s [s]."""
    return SAMPLE_PERIOD * float(np.count_nonzero(np.abs(response.speed) < _STANDSTILL))


def reversal_delays(response: Telemetry) -> NDArray[np.float64]:
    """Return how long after each reversal of the chirp the position leaves its extreme [s].

    Notes
    -----
    The chirp from 0 to f_1 in T has its k-th reversal at t² = (2 k - 1) T / (2 f_1); the last is at
    the end and has no delay that could be seen.
    """
    chirp = COMMANDS["chirp"]
    n = round(2.0 * chirp.end_frequency * chirp.duration) // 2
    k = np.arange(1, n + 2)
    reversals = np.sqrt((2 * k - 1) * chirp.duration / (2.0 * chirp.end_frequency))
    places = np.minimum(np.rint(reversals / SAMPLE_PERIOD).astype(int), len(response) - 1)
    t = times(len(response))
    delays = []
    for start, stop, sign in zip(places, places[1:], (-1.0) ** (k - 1), strict=False):
        stretch = sign * response.position[start:stop]
        last = start + np.flatnonzero(stretch >= stretch.max() - _ALIKE)[-1]
        delays.append(t[last] - t[start])
    return np.array(delays)


def phase_a_is_fed(response: Telemetry) -> NDArray[np.bool_]:
    """Return at which samples phase A is one of the driven pair (eq. 4.13), the motor from 0."""
    theta_m = np.cumsum(response.speed) * SAMPLE_PERIOD
    P = ActuatorParameters().P
    pair = np.floor(3.0 * np.mod(P * theta_m / np.pi + 1.0 / 6.0, 1.0))
    return pair > 0


def deviations(reference: NDArray[np.float64], monitor: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rms of the difference over that of the reference in each 0.1 s [%].

    The ripple of the PWM, which no model can match, is taken away from both.
    """
    n = round(STRETCH_S / SAMPLE_PERIOD)
    parts = [band_limited(row.reshape(-1, n), SAMPLE_PERIOD) for row in (reference, monitor)]
    return 100.0 * np.sqrt(
        np.mean((parts[0] - parts[1]) ** 2, axis=1) / np.mean(parts[0] ** 2, axis=1)
    )
