# SPDX-License-Identifier: Apache-2.0
"""Calibration of the monitor model on healthy windows of a unit."""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from ema_core.arrays import Array
from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters
from ema_monitor.calibration.alignment import shift_if_same
from ema_monitor.calibration.calibration import LEAST_SCATTER, Calibration
from ema_monitor.calibration.description_misfit import description_misfit
from ema_monitor.calibration.healthy_model import (
    WindowGroup,
    healthy_residuals,
    mean_residuals,
    sample_weights,
)
from ema_monitor.calibration.unit_fit import UnitFit, fit_unit
from ema_monitor.model.deviations import N_DEVIATIONS, Deviations
from ema_monitor.model.measured import measured_columns
from ema_monitor.model.monitor_model import FORMS, LEARNS_UNIT, MonitorModel, form_of
from ema_monitor.model.readings import TRAVEL, law_slopes
from ema_monitor.reason_texts import text_of
from ema_monitor.reasons import ColumnsContradict
from ema_monitor.windows.band import band_limited
from ema_monitor.windows.relations import law_offset, travel_ratio
from ema_monitor.windows.window import Window


def calibrate_model(
    windows: Sequence[Window],
    description: ActuatorDescription | None = None,
    form: str | None = None,
    *,
    structural: bool = True,
) -> Calibration:
    """Return a calibration of the monitor model, fitted to healthy windows of one unit.

    Parameters
    ----------
    windows
        Windows with one or several commands, at least one. Ten or more windows with the first
        command average out the PWM ripple. The fit reads the windows one at a time in several
        passes, so that the sequence may load them on demand. The uncertainty of measured causes is
        included.
    description
        Description of the unit; the built-in actuator if None.
    form
        Form of the monitor model; the default form of the drive if None. For the "source" form, no
        deviations are fitted: the calibration only has the correction, as in the thesis.
    structural
        Whether to fit the deviations of the unit from nominal, if the form supports it. Otherwise
        only the correction is fitted.

    Raises
    ------
    ValueError
        If there is no window, the form is not available for the drive, the unit deviates too far
        from its description, or a window has no excitation, a different sample period than the
        first window, or different columns than the description.
    """
    description = description or ActuatorDescription()
    form = form_of(description.drive, form)
    if not windows:
        raise ValueError("calibration needs at least one healthy window, got none")
    first, acquisition = windows[0], description.acquisition
    h = first.sample_period
    groups: list[list[int]] = []
    for number, window in enumerate(windows):
        missing, period = window.telemetry.missing, window.sample_period
        defect = ColumnsContradict.of(acquisition, missing) or window.excitation_defect()
        reason = text_of(defect) if defect else ""
        if not reason and period != h:
            reason = f"its sample period is {period:g} s, in the first window {h:g} s"
        if reason:
            raise ValueError(f"window {number}: {reason}")
        for group in groups:
            if shift_if_same(window.command, windows[group[0]].command, h) is not None:
                group.append(number)
                break
        else:
            groups.append([number])
    # The longest step that divides the sample period and is at most the step of the form.
    dt = h / math.ceil(h / FORMS[form] - 1e-6)
    parameters = description.parameters
    by_command = [WindowGroup(windows, group) for group in groups]
    nominal = MonitorModel(parameters, form, dt, acquisition=acquisition)
    for group in by_command:
        if misfit := description_misfit(group[0], nominal):
            raise ValueError(f"the windows do not fit a healthy actuator as described: {misfit}")
    unit = UnitFit(np.zeros(N_DEVIATIONS), np.zeros((N_DEVIATIONS, N_DEVIATIONS)))
    if structural and form in LEARNS_UNIT:
        unit = fit_unit(by_command, nominal)
    model = nominal.of_unit(Deviations.of(unit.deviations))
    of_first = by_command[0]
    correction, speed_correction = mean = mean_residuals(of_first, model)
    healthy_rms, healthy_speed_rms = _scatter(of_first, model, mean, h)
    model_rms, model_speed_rms = _uncorrected(by_command, model, h)
    relations = _relations(windows, parameters)
    return Calibration(
        actuator_id=description.actuator_id,
        serial_number=description.serial_number,
        parameters=parameters,
        form=form,
        dt=dt,
        sample_period=h,
        command=first.command,
        unit=Deviations.of(unit.deviations),
        unit_covariance=unit.covariance,
        correction=correction,
        speed_correction=speed_correction,
        healthy_rms=healthy_rms,
        healthy_speed_rms=healthy_speed_rms,
        model_rms=model_rms,
        model_speed_rms=model_speed_rms,
        windows=len(windows),
        travel_ratio=relations["travel_ratio"],
        law_offset=relations["law_offset"],
        acquisition=acquisition,
    )


def _relations(windows: Sequence[Window], parameters: ActuatorParameters) -> dict[str, float]:
    """Return the healthy relations between sensors, keyed by name, corrected for measured causes.

    A relation is the mean over the windows that determine it, or NaN without such windows.
    """
    relations: dict[str, list[float]] = {"travel_ratio": [], "law_offset": []}
    slopes = law_slopes(parameters)
    for window in windows:
        measured = measured_columns(window.measured)
        if travel := travel_ratio(window, parameters):
            relations["travel_ratio"].append(travel.value / (1.0 + float(TRAVEL @ measured)))
        if law := law_offset(window, parameters):
            relations["law_offset"].append(law.value - float(slopes @ measured))
    return {
        name: float(np.mean(values)) if values else math.nan for name, values in relations.items()
    }


def _scatter(
    windows: Sequence[Window], model: MonitorModel, mean: Array, h: float
) -> tuple[float, float]:
    """Return the expected band-limited rms residuals of current and speed in another window.

    They are NaN for a single window, or if all windows are the same.
    """
    m = len(windows)
    if m == 1:
        return float("nan"), float("nan")
    # Each window is compared with a mean that includes it; a later window is not part of the mean.
    scale = math.sqrt((m + 1.0) / (m - 1.0))
    differences = (residuals - mean for residuals in healthy_residuals(windows, model))
    return _meaningful(scale * _rms_in_band(differences, h))


def _uncorrected(
    groups: Sequence[Sequence[Window]], model: MonitorModel, h: float
) -> tuple[float, float]:
    """Return the band-limited rms residuals of current and speed without a correction."""
    rows = (
        of_window
        for group, weights in zip(groups, sample_weights(groups), strict=True)
        for of_window in healthy_residuals(group, model, weights)
    )
    return _meaningful(_rms_in_band(rows, h))


def _rms_in_band(rows: Iterable[Array], h: float) -> Array:
    """Return the band-limited rms, ``(2,)``, of residuals, ``(2, n)`` each."""
    squares, count = np.zeros(2), 0
    for row in rows:
        band = band_limited(row, h)
        squares += np.sum(np.square(band), axis=1)
        count += band.shape[1]
    return np.sqrt(squares / count)


def _meaningful(scatters: Array) -> tuple[float, float]:
    """Return the scatter of current and speed; NaN if it is too small to be meaningful."""
    current, speed = np.where(scatters > LEAST_SCATTER, scatters, np.nan).tolist()
    return current, speed
