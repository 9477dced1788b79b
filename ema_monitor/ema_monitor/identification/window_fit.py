# SPDX-License-Identifier: Apache-2.0
"""Measured and modelled signals of a window, for display."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.description import ActuatorDescription
from ema_core.faults import healthy_faults
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.knowledge import FLOOR, Knowledge
from ema_monitor.identification.objective import PLAIN
from ema_monitor.identification.preview import Preview
from ema_monitor.identification.search import ModelIdentification
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.model.deviations import COLUMNS
from ema_monitor.model.monitor_model import Response
from ema_monitor.model.readings import read
from ema_monitor.windows.window import Window

MOST_VALUES: Final = 500
"""Largest number of values of a thinned signal."""


@dataclass(frozen=True, eq=False)
class WindowFit:
    """Measured and modelled signals of a window, averaged over equal periods, ``(m,)`` each."""

    period: float
    """Averaging period, which is the spacing of the values [s]."""
    start: float
    """Time from the first sample of the window to the middle of the first period [s]."""
    command: Array
    """Commanded user angle [rad]."""
    position: Array
    """Measured user angle [rad]."""
    current: Array
    """Measured equivalent current [A]; ``(0,)`` if not measured."""
    estimated_current: Array
    """Modelled equivalent current at the estimate [A]."""
    speed: Array
    """Measured motor speed [rad/s]; if not measured, the speed of the fast shaft behind the play,
    from the position."""
    estimated_speed: Array
    """Modelled speed at the estimate, of the same shaft as ``speed`` [rad/s]."""


def expected_signals(window: Window, estimate: Estimate, calibration: Calibration) -> Response:
    """Return current and speed of the calibrated model in a window, ``(2, n)`` each [A, rad/s].

    The first row is the response at the estimate, the second row is the response of the healthy
    actuator.

    Parameters
    ----------
    window
        The window.
    estimate
        Estimate of the window, with faults.
    calibration
        Calibration with which the estimate was made.

    Raises
    ------
    ValueError
        If the sample period is not a multiple of the step of the model.
    """
    faults = np.array([estimate.faults, healthy_faults()])
    columns = np.zeros((2, len(COLUMNS)))
    # Measured causes apply to the healthy actuator as well; estimated causes do not.
    for row, causes in ((0, (*estimate.measured, *estimate.causes)), (1, estimate.measured)):
        for cause in causes:
            columns[row, COLUMNS.index(cause.name)] = cause.value
    deviations, position = read(columns, window)
    response = calibration.model().respond(
        window, faults, estimate.play_offset, deviations=deviations, position=position
    )
    return calibration.expect(response, window)


def window_fit(window: Window, estimate: Estimate, calibration: Calibration) -> WindowFit:
    """Return the measured signals of a window, and the modelled signals at its estimate.

    Parameters
    ----------
    window
        The window.
    estimate
        Estimate of the window. If it has no faults, the modelled signals are NaN.
    calibration
        Calibration with which the estimate was made.

    Raises
    ------
    ValueError
        If the sample period is not a multiple of the step of the model.
    """
    current, speed = np.full((2, len(window)), np.nan)
    if np.isfinite(estimate.faults).all():
        expected = expected_signals(window, estimate, calibration)
        current, speed = expected.current[0], expected.speed[0]
    recorded = window.telemetry
    rows = (
        recorded.command[1:],
        recorded.position[1:],
        window.current,
        current,
        window.speed(calibration.parameters.tau),
        speed,
    )
    each = -(-len(window) // MOST_VALUES)
    means = [row[: len(row) // each * each].reshape(-1, each).mean(axis=1) for row in rows]
    h = window.sample_period
    return WindowFit(each * h, 0.5 * (each + 1) * h, *means)


def in_stretch(
    estimate: Estimate,
    stretch: Window,
    description: ActuatorDescription,
    calibration: Calibration,
    search: SearchSettings,
) -> Estimate:
    """Return an estimate of several stretches with play and causes fitted to one stretch.

    The faults remain at the estimate, within the mismatch of the model.

    Parameters
    ----------
    estimate
        Valid estimate of several stretches.
    stretch
        The stretch.
    description, calibration, search
        Description of the actuator, its calibration for any motion, and the settings of the search.

    Raises
    ------
    ValueError
        If the stretch cannot be fitted with these faults.
    """
    faults = np.array(estimate.faults)
    knowledge = Knowledge(PLAIN.encode(faults), np.diag(FLOOR**2))
    load = Preview.of(stretch, calibration, knowledge, faults).load
    of_stretch = ModelIdentification(
        stretch, description, calibration, search, True, faults, knowledge, load
    ).estimate()
    if not np.isfinite(of_stretch.fitness):
        raise ValueError("the stretch cannot be fitted with the faults of the motion")
    return replace(
        estimate,
        play_offset=of_stretch.play_offset,
        causes=of_stretch.causes,
        measured=of_stretch.measured,
    )
