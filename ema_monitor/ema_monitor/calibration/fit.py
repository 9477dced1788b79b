"""Calibrating: from healthy windows of one unit to its calibration."""

import math
from collections.abc import Iterable, Iterator, Sequence
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from ema_core.arrays import Array, Flags
from ema_core.description import ActuatorDescription
from ema_core.faults import healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_monitor.calibration.alignment import moved, shift_between, shift_if_same
from ema_monitor.calibration.calibration import LEAST_SCATTER, Calibration
from ema_monitor.model.deviations import COLUMNS, N_DEVIATIONS, NAMES, Deviations, unit_priors
from ema_monitor.model.measured import measured_columns
from ema_monitor.model.monitor_model import FORMS, LEARNS_UNIT, MonitorModel, Response, form_of
from ema_monitor.model.readings import TRAVEL, law_slopes, read
from ema_monitor.windows.band import BAND_CORRELATION, band_limited, rms, speed_weight
from ema_monitor.windows.relations import law_offset, travel_ratio
from ema_monitor.windows.window import Window

_STEPS = 0.05
_SETTLED = 0.02
_SHARES = (1.0, 0.5, 0.25, 0.1, 0.03)
_WORTHWHILE = 0.3
_NOTABLE = 0.4
_ALWAYS_FITTED = ("lift", "friction", "stribeck_speed", "inertia")
_LEAST_NOISE = 1e-2
_CHANGED = 1.5
_MATTERS = 0.1
_LOWEST_CORRELATION = 0.5
_NEAR = 0.4
_KNOWN_FACTORS = {
    "position": {180.0 / math.pi: "degrees", 1e3: "mrad"},
    "speed": {30.0 / math.pi: "rpm", 180.0 / math.pi: "degrees per second", 1e3: "mrad/s"},
    "current": {1e3: "mA"},
}


class UnitFit(NamedTuple):
    """Deviations of a unit, ``(25,)``, and their covariance, ``(25, 25)``."""

    deviations: Array
    covariance: Array


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
    by_command = [_Group(windows, group) for group in groups]
    nominal = MonitorModel(parameters, form, dt, acquisition=acquisition)
    for group in by_command:
        if reason := _column_defect(group[0], _healthy_response(group[0], nominal)):
            reason += _examples_that_matter(group[0], nominal)
            raise ValueError(f"the windows do not fit a healthy actuator as described: {reason}")
    unit = UnitFit(np.zeros(N_DEVIATIONS), np.zeros((N_DEVIATIONS, N_DEVIATIONS)))
    if structural and form in LEARNS_UNIT:
        unit = _fit_unit(by_command, nominal)
    model = nominal.of_unit(Deviations.of(unit.deviations))
    of_first = by_command[0]
    correction, speed_correction = mean = _mean_missed(of_first, model)
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


class _Group(Sequence[Window]):
    """Windows of one command, read when needed."""

    def __init__(self, windows: Sequence[Window], numbers: list[int]) -> None:
        self._windows, self._numbers = windows, numbers

    def __len__(self) -> int:
        return len(self._numbers)

    def __getitem__(self, index: Any) -> Any:
        return self._windows[self._numbers[index]]


def _missed(
    windows: Sequence[Window], model: MonitorModel, weights: Array | float = 1.0
) -> Iterator[Array]:
    """Yield the healthy model's residuals of current and speed, ``(2, n)`` [A, rad/s] a window.

    All windows are laid over the first. What is missed is multiplied by ``weights``, ``(n,)``.
    """
    command = windows[0].command
    for window in windows:
        response = _healthy_response(window, model)
        shift = shift_between(window.command, command, windows[0].telemetry.sample_period)
        rows = window.missed(response.current[0], response.speed[0], model.parameters.tau)
        yield np.array([weights * moved(row, -shift) for row in rows])


def _mean_missed(
    windows: Sequence[Window], model: MonitorModel, weights: Array | float = 1.0
) -> Array:
    """Return the mean residuals of the healthy model over windows, ``(2, n)``."""
    return reduce(np.add, _missed(windows, model, weights)) / len(windows)


def _weights(groups: Sequence[Sequence[Window]]) -> list[Array | float]:
    """Return the weights of samples in the fit of a unit, ``(n,)`` for each command.

    Ordinary motion is slow or stands still for much of its time, where the model of the mean
    current is at its worst: as soon as a window dwells, samples count as they do in an estimate
    (M15). In test cycles alone all count alike.
    """
    if all(np.all(group[0].moves) for group in groups):
        return [1.0] * len(groups)
    return [group[0].weights for group in groups]


def _healthy_response(window: Window, model: MonitorModel) -> Response:
    """Return the response of the healthy actuator under the window's measured causes."""
    deviations, position = read(measured_columns(window.measured)[None], window)
    return model.respond(
        window, healthy_faults(), _play(window), deviations=deviations, position=position
    )


def _examples_that_matter(window: Window, model: MonitorModel) -> str:
    """Return which parameters have the built-in example's value and matter in a window.

    Nothing is reported for the example itself. A parameter matters if it changes the response by a
    tenth.
    """
    example, actual = ActuatorParameters().as_mapping(), model.parameters.as_mapping()
    left = [name for name, value in example.items() if actual[name] == value and value]
    if len(left) >= sum(bool(value) for value in example.values()):
        return ""
    expected = _healthy_response(window, model)
    names = []
    for name in left:
        try:
            changed = model.parameters.replace({name: _CHANGED * actual[name]})
        except ValueError:  # it contradicts another one
            continue
        other = MonitorModel(changed, model.form, model.dt, acquisition=model.acquisition)
        response = _healthy_response(window, other)
        for one, before in ((response.current, expected.current), (response.speed, expected.speed)):
            if np.linalg.norm(one - before) > _MATTERS * np.linalg.norm(before):
                names.append(f"{name} = {actual[name]:g}")
                break
    if not names:
        return ""
    return f"; these have the built-in example's values and matter here: {', '.join(names)}"


class _UnitProblem:
    """What a unit's deviations are fitted to: the mean of each command, in its band.

    ``x`` are the values of the deviations that ``priors`` names, ``(d,)``.
    """

    def __init__(self, groups: Sequence[Sequence[Window]], nominal: MonitorModel) -> None:
        self._groups, self._nominal = groups, nominal
        parameters = nominal.parameters
        self._weights = _weights(groups)
        self._h = groups[0][0].sample_period
        self._stiffness = speed_weight(parameters)
        # Nothing is missed of a current that is not measured.
        self._current_weight = float(nominal.acquisition.current != "none")
        travel = max(group[0].excitation for group in groups)
        self.priors = unit_priors(parameters, travel, nominal.form)
        self._columns = [NAMES.index(one.name) for one in self.priors]
        self.expected, self.sigma, self.lowest, self.highest = np.array(
            [(one.expected, one.sigma, one.lowest, one.reach) for one in self.priors]
        ).T
        # A difference of a fraction of the prior, and enough to be seen through the friction.
        self._steps = _STEPS * np.minimum(20.0 * self.sigma, self.highest)

    def deviations(self, x: Array) -> Array:
        """Return all deviations, ``(..., 25)``, of ``x``, ``(..., d)``."""
        values = np.zeros((*x.shape[:-1], N_DEVIATIONS))
        values[..., self._columns] = x
        return values

    def covariance(self, known: Array) -> Array:
        """Return the covariance of all deviations, ``(25, 25)``, from ``x``'s, ``(d, d)``."""
        covariance = np.zeros((N_DEVIATIONS, N_DEVIATIONS))
        covariance[np.ix_(self._columns, self._columns)] = known
        return covariance

    def missed(self, x: Array) -> Array:
        """Return the residuals of the model, ``(r,)`` [A]."""
        model = self._model(x)
        return np.concatenate(
            [
                self._in_band(_mean_missed(group, model, weights))
                for group, weights in zip(self._groups, self._weights, strict=True)
            ]
        )

    def slopes(self, x: Array) -> Array:
        """Return the derivatives of the model's response, ``(r, d)``."""
        up = np.minimum(self._steps, self.highest - x)
        down = np.minimum(self._steps, x - self.lowest)
        sides = self.deviations(np.concatenate([np.diag(up), -np.diag(down)]))
        sides = np.pad(sides, ((0, 0), (0, len(COLUMNS) - N_DEVIATIONS)))
        return self._differences(x, [sides] * len(self._groups)) / (up + down)

    def effects_of_measured(self, x: Array) -> Array:
        """Return the effect of one sigma of each measured cause on the response, ``(r, k)`` [A].

        A sensor is as wrong in all windows as in one.
        """
        measured = [{one.name: one for one in group[0].measured} for group in self._groups]
        names = sorted({name for by_name in measured for name in by_name})
        sides = []
        for by_name in measured:
            known = [[by_name[name]] if name in by_name else [] for name in names]
            errors = [[one._replace(value=one.sigma) for one in causes] for causes in known]
            above = np.array([measured_columns(causes) for causes in errors])
            above = above.reshape(-1, len(COLUMNS))
            sides.append(np.concatenate([above, -above]))
        if not names:
            return np.zeros((len(self.missed(x)), 0))
        return self._differences(x, sides) / 2.0

    def _differences(self, x: Array, sides: Sequence[Array]) -> Array:
        """Return how the response to deviations differs from that to others, ``(r, k)`` [A].

        Parameters
        ----------
        x
            Where.
        sides
            Of each command those, and then the others, in the order of `COLUMNS`, ``(2 k, 28)``.
        """
        model, columns = self._model(x), []
        for group, weights, of_group in zip(self._groups, self._weights, sides, strict=True):
            first = group[0]
            faults = np.tile(healthy_faults(), (len(of_group), 1))
            deviations, position = read(of_group + measured_columns(first.measured), first)
            response = model.respond(
                first, faults, _play(first), deviations=deviations, position=position
            )
            pairs = zip(*response, strict=True)
            rows = np.array([self._in_band(np.array(row) * weights) for row in pairs])
            above, below = np.split(rows, 2)
            columns.append((above - below).T)
        return np.concatenate(columns)

    def lowest_within(self, normal: Array, gradient: Array, x: Array, active: Flags) -> Array:
        """Return where a quadratic about ``x`` is lowest within the bounds of the active ones."""
        from ema_monitor.optimizers.bounded_quadratic import lowest_in_box  # with the compiler

        span = (self.highest - self.lowest)[active]
        place = x.copy()
        place[active] = self.lowest[active] + span * lowest_in_box(
            normal[np.ix_(active, active)] * np.outer(span, span),
            gradient[active] * span,
            (x - self.lowest)[active] / span,
        )
        return place

    def _model(self, x: Array) -> MonitorModel:
        return self._nominal.of_unit(Deviations.of(self.deviations(x)))

    def _in_band(self, rows: Array) -> Array:
        """Return current and speed, ``(2, n)``, in their band as one row [A]."""
        current, speed = band_limited(rows, self._h)
        return np.concatenate([self._current_weight * current, self._stiffness * speed])


def _fit_unit(groups: Sequence[Sequence[Window]], nominal: MonitorModel) -> UnitFit:
    """Fit the deviations of a unit from nominal to healthy windows.

    Gauss-Newton on current and speed in their band, with priors, which only matter for deviations
    that the windows do not determine. It begins with lift, friction and inertia. Each further
    deviation is fitted only if it explains most of the remaining residuals, one after the other:
    otherwise it would absorb residuals with other reasons.
    """
    problem = _UnitProblem(groups, nominal)
    priors, sigma = problem.priors, problem.sigma
    prior = np.diag(1.0 / sigma**2)
    x = problem.expected
    left = problem.missed(x)
    active = np.array([one.name in _ALWAYS_FITTED for one in priors])
    while True:
        slopes = problem.slopes(x)
        # The remaining residual, at least a hundredth of an ampere, sets the weight of a value.
        noise = math.sqrt(BAND_CORRELATION) * max(rms(left), _LEAST_NOISE)
        away = x - problem.expected
        cost = left @ left / noise**2 + away @ prior @ away
        normal = slopes.T @ slopes / noise**2 + prior
        gradient = prior @ away - slopes.T @ left / noise**2
        target = problem.lowest_within(normal, gradient, x, active)
        before = x
        for share in _SHARES:
            trial = before + share * (target - before)
            trial_left, away = problem.missed(trial), trial - problem.expected
            if trial_left @ trial_left / noise**2 + away @ prior @ away < cost:
                x, left = trial, trial_left
                break
        if np.max(np.abs(x - before) / sigma) < _SETTLED:
            added = _most_explaining(normal, -gradient, active, _NOTABLE * sigma)
            least = max(left @ left, len(left) * _LEAST_NOISE**2) / noise**2
            if added is None or added.gain < _WORTHWHILE * least:
                break
            active[added.number] = True
    for one, value in zip(priors, x, strict=True):
        # That there is no viscous friction at all is possible.
        if not -one.reach < value < one.reach:
            raise ValueError(
                f"the fit drives {one.name} of the unit to its bound {value:g}: expected about "
                f"{one.expected:g} ± {one.sigma:g}; do the parameters belong to this actuator, "
                "and are the units and signs of the columns right?"
            )
    # What was left out may still be there, as far as the windows and the priors let it.
    left_out = np.where(active, 0.0, np.linalg.solve(normal, gradient))
    known: Array = np.linalg.inv(normal) + np.diag(left_out**2)  # pyright: ignore[reportAssignmentType]
    # Measured causes were assumed known throughout.
    shifts = np.linalg.solve(normal, slopes.T @ problem.effects_of_measured(x) / noise**2)
    return UnitFit(problem.deviations(x), problem.covariance(known + shifts @ shifts.T))


class _Addition(NamedTuple):
    """A deviation to be fitted, and by how much that lowers the normalised cost."""

    number: int
    gain: float


def _most_explaining(
    normal: Array, gradient: Array, active: Flags, least: Array
) -> _Addition | None:
    """Return which deviation, besides those that are fitted, explains most.

    None when there is none that would be as large as ``least``, ``(d,)``, its sign aside.
    """
    best = None
    for number in np.flatnonzero(~active):
        trial = active.copy()
        trial[number] = True
        move = np.linalg.solve(normal[np.ix_(trial, trial)], gradient[trial])
        gain = float(gradient[trial] @ move)
        is_notable = abs(move[np.sum(trial[:number])]) >= least[number]
        if is_notable and (best is None or gain > best.gain):
            best = _Addition(int(number), gain)
    return best


def _play(window: Window) -> float:
    return 0.0 if window.play is None else window.play


def _scatter(
    windows: Sequence[Window], model: MonitorModel, mean: Array, h: float
) -> tuple[float, float]:
    """Return the rms in current and speed that another window has in its band after correction."""
    m = len(windows)
    if m == 1:
        return float("nan"), float("nan")
    # Each window is itself in the mean that it is compared with; another one will not be.
    scale = math.sqrt((m + 1.0) / (m - 1.0))
    return _known(scale * _rms_in_band((missed - mean for missed in _missed(windows, model)), h))


def _uncorrected(
    groups: Sequence[Sequence[Window]], model: MonitorModel, h: float
) -> tuple[float, float]:
    """Return the rms in current and speed that the model alone misses in its band."""
    rows = (
        missed
        for group, weights in zip(groups, _weights(groups), strict=True)
        for missed in _missed(group, model, weights)
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
