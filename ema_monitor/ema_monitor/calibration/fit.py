"""Calibrating: from healthy windows of one unit to its calibration."""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from ema_core.arrays import Array
from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters
from ema_monitor.calibration.alignment import shift_if_same
from ema_monitor.calibration.calibration import LEAST_SCATTER, Calibration
from ema_monitor.calibration.healthy_model import (
    WindowGroup,
    healthy_response,
    mean_missed,
    missed,
    sample_weights,
)
from ema_monitor.calibration.unit_fit import UnitFit, fit_unit
from ema_monitor.model.deviations import N_DEVIATIONS, Deviations
from ema_monitor.model.measured import measured_columns
from ema_monitor.model.monitor_model import FORMS, LEARNS_UNIT, MonitorModel, Response, form_of
from ema_monitor.model.readings import TRAVEL, law_slopes
from ema_monitor.windows.band import band_limited
from ema_monitor.windows.relations import law_offset, travel_ratio
from ema_monitor.windows.window import Window

_CHANGED = 1.5
_MATTERS = 0.1
_LOWEST_CORRELATION = 0.5
_NEAR = 0.4
_KNOWN_FACTORS = {
    "position": {180.0 / math.pi: "degrees", 1e3: "mrad"},
    "speed": {30.0 / math.pi: "rpm", 180.0 / math.pi: "degrees per second", 1e3: "mrad/s"},
    "current": {1e3: "mA"},
}


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
        reason = acquisition.contradiction(missing) or window.excitation_defect()
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
        if reason := _column_defect(group[0], healthy_response(group[0], nominal)):
            reason += _examples_that_matter(group[0], nominal)
            raise ValueError(f"the windows do not fit a healthy actuator as described: {reason}")
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


def _examples_that_matter(window: Window, model: MonitorModel) -> str:
    """Return which parameters have the built-in example's value and matter in a window.

    Nothing is reported for the example itself. A parameter matters if it changes the response by a
    tenth.
    """
    example, actual = ActuatorParameters().as_mapping(), model.parameters.as_mapping()
    left = [name for name, value in example.items() if actual[name] == value and value]
    if len(left) >= sum(bool(value) for value in example.values()):
        return ""
    expected = healthy_response(window, model)
    names = []
    for name in left:
        try:
            changed = model.parameters.replace({name: _CHANGED * actual[name]})
        except ValueError:  # it contradicts another one
            continue
        other = MonitorModel(changed, model.form, model.dt, acquisition=model.acquisition)
        response = healthy_response(window, other)
        for one, before in ((response.current, expected.current), (response.speed, expected.speed)):
            if np.linalg.norm(one - before) > _MATTERS * np.linalg.norm(before):
                names.append(f"{name} = {actual[name]:g}")
                break
    if not names:
        return ""
    return f"; these have the built-in example's values and matter here: {', '.join(names)}"


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


def _column_defect(window: Window, expected: Response) -> str:
    """Return which column of a window is wrong by the nominal response, if one is, and how."""
    measured = window.telemetry
    travel = window.command - window.command[0]
    moves = window.moves
    pairs = {"position": (measured.position - measured.position[0], travel)}
    if len(measured.speed):
        pairs["speed"] = (measured.speed[1:], expected.speed[0])
    if len(measured.current):
        pairs["current"] = (measured.current[1:] * moves, expected.current[0] * moves)
    for name, (row, model) in pairs.items():
        h = window.sample_period
        factors = {1.0: ""} | _KNOWN_FACTORS[name]
        if reason := _difference(band_limited(row, h), band_limited(model, h), factors):
            return f"{name}: {reason}"
    return ""


def _difference(row: Array, model: Array, factors: dict[float, str]) -> str:
    """Return how a row differs from its expectation; empty when it does not."""
    size = float(np.linalg.norm(row) * np.linalg.norm(model))
    correlation = float(row @ model) / size if size > 0.0 else 0.0
    if abs(correlation) < _LOWEST_CORRELATION:
        return (
            f"it has little to do with what the model expects (correlation {correlation:.2f}): "
            "is it another column?"
        )
    ratio = float(row @ model) / float(model @ model)
    sign = "the sign is reversed" if ratio < 0.0 else ""
    for factor, unit in factors.items():
        if abs(abs(ratio) / factor - 1.0) < _NEAR:
            return " and ".join(filter(None, [sign, unit and f"it seems to be in {unit}"]))
    return f"it is {ratio:.3g} times what the model expects: is its unit, or the gear ratio, right?"
