"""Calibrating: from healthy windows of one unit to its calibration."""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from ema_core.arrays import Array
from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters
from ema_monitor.calibration.alignment import shift_if_same
from ema_monitor.calibration.calibration import LEAST_SCATTER, Calibration
from ema_monitor.calibration.description_misfit import description_misfit
from ema_monitor.calibration.healthy_model import WindowGroup, mean_missed, missed, sample_weights
from ema_monitor.calibration.unit_fit import UnitFit, fit_unit
from ema_monitor.model.deviations import N_DEVIATIONS, Deviations
from ema_monitor.model.measured import measured_columns
from ema_monitor.model.monitor_model import FORMS, LEARNS_UNIT, MonitorModel, form_of
from ema_monitor.model.readings import TRAVEL, law_slopes
from ema_monitor.reason_texts import text_of
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
    """Calibrate the monitor model on healthy windows of one actuator.

    Parameters
    ----------
    windows
        Windows of one or several commands, at least one; ten or more of the first one average out
        the PWM's ripple. They are used one at a time, several times over, so that they may be read
        when needed. Causes measured with them are assumed known, within their sigma.
    description
        The unit that the windows were taken from; the built-in actuator when None.
    form
        Form of the monitor model, the drive's form when None. No deviations are fitted for the
        "source" form: the thesis's calibration, which goes with it, is the correction alone.
    structural
        Whether to fit the unit's deviations from nominal, if the form has them; otherwise only the
        correction is fitted.

    Raises
    ------
    ValueError
        When there is no window, one has no excitation, another sample period than the first or
        other columns than the description says, the unit deviates impossibly far from its
        description, or there is no such model of its drive.
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
        unexcited = window.excitation_defect()
        reason = acquisition.contradiction(missing) or (text_of(unexcited) if unexcited else "")
        if not reason and period != h:
            reason = f"it has samples of {period:g} s, the first of {h:g} s"
        if reason:
            raise ValueError(f"window {number}: {reason}")
        for group in groups:
            if shift_if_same(window.command, windows[group[0]].command, h) is not None:
                group.append(number)
                break
        else:
            groups.append([number])
    # The longest step up to the form's own that divides the sample period.
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
    correction, speed_correction = mean = mean_missed(of_first, model)
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
    """Return the relations between columns by name, except measured ones.

    Each is the mean over the windows in which it can be measured; NaN without any.
    """
    relations: dict[str, list[float]] = {"travel_ratio": [], "law_offset": []}
    slopes = law_slopes(parameters)
    for window in windows:
        measured = measured_columns(window.measured)
        if travel := travel_ratio(window, parameters):
            relations["travel_ratio"].append(travel.value / (1.0 + float(TRAVEL @ measured)))
        if law := law_offset(window, parameters):
            relations["law_offset"].append(law.value - float(slopes @ measured))
    return {name: float(np.mean(one)) if one else math.nan for name, one in relations.items()}


def _scatter(
    windows: Sequence[Window], model: MonitorModel, mean: Array, h: float
) -> tuple[float, float]:
    """Return the rms in current and speed that another window has in its band after correction."""
    m = len(windows)
    if m == 1:
        return float("nan"), float("nan")
    # Each window is itself in the mean that it is compared with; another one will not be.
    scale = math.sqrt((m + 1.0) / (m - 1.0))
    return _known(scale * _rms_in_band((rows - mean for rows in missed(windows, model)), h))


def _uncorrected(
    groups: Sequence[Sequence[Window]], model: MonitorModel, h: float
) -> tuple[float, float]:
    """Return the rms in current and speed that the model alone misses in its band."""
    rows = (
        of_window
        for group, weights in zip(groups, sample_weights(groups), strict=True)
        for of_window in missed(group, model, weights)
    )
    return _known(_rms_in_band(rows, h))


def _rms_in_band(rows: Iterable[Array], h: float) -> Array:
    """Return the rms of current and speed in their band over the rows of windows, ``(2, n)``."""
    squares, count = np.zeros(2), 0
    for row in rows:
        band = band_limited(row, h)
        squares += np.sum(np.square(band), axis=1)
        count += band.shape[1]
    return np.sqrt(squares / count)


def _known(scatters: Array) -> tuple[float, float]:
    """Return two scatters, NaN for one so small that it is unknown."""
    current, speed = np.where(scatters > LEAST_SCATTER, scatters, np.nan).tolist()
    return current, speed
