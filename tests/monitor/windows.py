# SPDX-License-Identifier: Apache-2.0
"""Synthetic windows, without an actuator."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ema_core.commands import THESIS_CHIRP, Command
from ema_core.faults import FAULT_NAMES, N_FAULTS, FaultVector, fault_vector
from ema_core.telemetry import Telemetry
from ema_monitor.api import find_windows
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate, refusal
from ema_monitor.identification.fitness import FITNESS, LeastSquares
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.reasons import NoCalibration, StatedReason
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window
from ema_sim.api import simulate


def window_from(
    command: ArrayLike,
    *,
    position: float = 0.0,
    speed: ArrayLike | float = 0.0,
    current: ArrayLike | float = 0.0,
    sample_period: float = 1e-4,
    play: float | None = 0.0,
) -> Window:
    """Return a window with a command, `(n + 1,)` with the value at the start, and initial state."""
    command = np.array(command, dtype=float)
    columns = (
        np.array(np.broadcast_to(np.asarray(column, dtype=float), command.shape))
        for column in (current, position, speed)
    )
    return Window(Telemetry(0, sample_period, 0, command, *columns), play)


Made = TypeVar("Made")


def once(make: Callable[..., Made]) -> Callable[..., Made]:
    """Return a function that caches its results by the text of its arguments."""
    made: dict[str, Made] = {}

    def get(*arguments: Any) -> Made:
        key = repr(arguments)
        if key not in made:
            made[key] = make(*arguments)
        return made[key]

    return get


@once
def recorded(
    faults: Mapping[str, float], causes: Mapping[str, float], command: Command = THESIS_CHIRP
) -> Window:
    """Return a window of the simulated actuator with faults and hidden causes, cached."""
    return find_windows(simulate(faults, causes=causes, command=command, seed=3))[0]


def changed(window: Window, **columns) -> Window:
    """Return the window with some columns of its telemetry replaced."""
    return replace(window, telemetry=replace(window.telemetry, **columns))


def answered(window: Window, current: ArrayLike, speed: ArrayLike) -> Window:
    """Return the window with current and speed after its start replaced, `(n,)` [A, rad/s]."""
    start = window.telemetry
    return changed(
        window, current=np.append(start.current[0], current), speed=np.append(start.speed[0], speed)
    )


def refused(reason: str) -> Estimate:
    """Return the estimate of a window in which no faults can be identified."""
    return refusal(
        Refusal(0, 1, StatedReason(reason)),
        NoCalibration("calibration.yaml"),
        SearchSettings(),
        StatedReason(reason),
    )


def estimated(
    faults: Mapping[str, float] | None = None,
    *,
    sigma: float = 0.01,
    unknown: Collection[str] = (),
    **values: Any,
) -> Estimate:
    """Return an estimate of faults that all have the same sigma, except for the unknown ones."""
    unobservable = np.array([name in unknown for name in FAULT_NAMES])
    covariance = sigma**2 * np.eye(N_FAULTS)
    covariance[unobservable] = covariance[:, unobservable] = np.nan
    return replace(
        refused(""),
        faults=FaultVector.of(fault_vector(dict(faults or {}))),
        covariance=covariance,
        unobservable=unobservable,
        valid=True,
        **values,
    )


def fitness_for(name: str, window: Window, calibration: Calibration) -> LeastSquares:
    """Return a distance from a window with the scatter of a calibration."""
    scatter = calibration.reference(window).scatter
    return FITNESS[name](window, calibration, scatter)


def made_by(
    calibration: Calibration, window: Window, faults: Mapping[str, float], play: float = 1.0
) -> Window:
    """Return a window with the response of the calibrated model to faults, at a play position."""
    response = calibration.model().respond(window, fault_vector(dict(faults)), play)
    [current], [speed] = calibration.expect(response, window)
    return answered(window, current, speed)


def shortened(calibration: Calibration, samples: int = 50) -> Calibration:
    """Return the calibration with only its first samples, which are faster to read and write."""
    return replace(
        calibration,
        command=calibration.command[: samples + 1],
        correction=calibration.correction[:samples],
        speed_correction=calibration.speed_correction[:samples],
    )
