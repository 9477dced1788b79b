# SPDX-License-Identifier: Apache-2.0
"""Picture of the fit of an estimate in its window, or in its last stretch of motion."""

from matplotlib.figure import Figure

from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.identification.window_fit import in_stretch
from ema_monitor.plot import plot_fit
from ema_monitor.recordings.windows import RecordedWindow
from ema_monitor.windows.window import Window


def draw_fit(
    last: RecordedWindow,
    estimate: Estimate,
    calibration: Calibration,
    search: SearchSettings,
    since_ns: int | None = None,
) -> Figure:
    """Return a figure of measured and simulated telemetry for an estimate.

    Parameters
    ----------
    last
        Window, or last stretch, of the estimate.
    estimate
        The estimate to draw.
    calibration
        Calibration of the unit.
    search
        Settings of the identification.
    since_ns
        Timestamp at zero of the time axis [ns]; None for the start of the window.

    Raises
    ------
    ValueError
        If the window cannot be used.
    """
    window = last.window
    if not isinstance(window, Window):
        raise ValueError(f"window {last.number} cannot be used: {window.reason}")
    if estimate.stretches:
        calibration = calibration.of_any_motion()
        estimate = in_stretch(estimate, window, last.description, calibration, search)
    return plot_fit(window, estimate, calibration, since_ns=since_ns)
