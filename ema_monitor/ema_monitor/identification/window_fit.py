"""What was measured in a window beside what the model expects, for display."""

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
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.model.deviations import COLUMNS
from ema_monitor.model.monitor_model import Response
from ema_monitor.model.readings import read
from ema_monitor.windows.window import Window

MOST_VALUES: Final = 500
"""Largest number of values of a thinned signal."""


@dataclass(frozen=True, eq=False)
class WindowFit:
    """Signals of a window, each value the mean over a period, ``(m,)`` each.

    Attributes
    ----------
    period
        Time from one value to the next [s].
    start
        Time of the first value, the middle of its period, after the window's first sample [s].
    command, position
        Commanded and measured user angle [rad].
    current, estimated_current
        Measured equivalent current, ``(0,)`` where it is not measured, and that of the model at the
        estimate [A].
    speed, estimated_speed
        Measured motor speed and that of the model at the estimate [rad/s]; where the speed is not
        measured, both are that of the fast shaft behind the play, the former by the position.
    """

    period: float
    start: float
    command: Array
    position: Array
    current: Array
    estimated_current: Array
    speed: Array
    estimated_speed: Array


def expected_signals(window: Window, estimate: Estimate, calibration: Calibration) -> Response:
    """Return current and speed of the calibrated model in a window, ``(2, n)`` each.

    The first row is that at the estimate, the second that of the healthy actuator.

    The arguments, and the error raised, are those of `window_fit`; the estimate has faults.
    """
    faults = np.array([estimate.faults, healthy_faults()])
    columns = np.zeros((2, len(COLUMNS)))
    # What was measured holds for the healthy actuator as well; what the window shows, holds more.
    for row, causes in ((0, (*estimate.measured, *estimate.causes)), (1, estimate.measured)):
        for one in causes:
            columns[row, COLUMNS.index(one.name)] = one.value
    deviations, position = read(columns, window)
    response = calibration.model().respond(
        window, faults, estimate.play_offset, deviations=deviations, position=position
    )
    return calibration.expect(response, window)


def window_fit(window: Window, estimate: Estimate, calibration: Calibration) -> WindowFit:
    """Return a window beside the response of the calibrated model at its estimate.

    Parameters
    ----------
    window
        The window.
    estimate
        The estimate in it; the model's signals are NaN where it has no faults, as of a refusal.
    calibration
        Calibration that it was made with.

    Raises
    ------
    ValueError
        When the sample period is no multiple of the model's step, so that no fit was possible.
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
    """Return an estimate with the place in the play and the causes that one stretch has.

    An estimate of several stretches has the causes of all. Load and play of one are fitted to it
    with the faults of all taken for known.

    Parameters
    ----------
    estimate
        The estimate of all, valid.
    stretch
        The stretch.
    description, calibration, search
        The actuator, what holds for any motion of it, and how it was identified.
    """
    faults = np.array(estimate.faults)
    known = Knowledge(PLAIN.encode(faults), np.diag(FLOOR**2))
    load = Preview.of(stretch, calibration, known, faults).load
    of_stretch = ModelIdentification(
        stretch, description, calibration, search, True, faults, known, load
    ).estimate()
    if not np.isfinite(of_stretch.fitness):
        raise ValueError("the stretch cannot be fitted with the faults of the motion")
    return replace(
        estimate,
        play_offset=of_stretch.play_offset,
        causes=of_stretch.causes,
        measured=of_stretch.measured,
    )
