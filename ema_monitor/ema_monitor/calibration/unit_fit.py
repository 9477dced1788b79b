# SPDX-License-Identifier: Apache-2.0
"""Fit of a unit's deviations from its description to healthy windows."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array, Flags
from ema_core.faults import healthy_faults
from ema_monitor.calibration.healthy_model import mean_residuals, place_in_play, sample_weights
from ema_monitor.model.deviations import COLUMNS, N_DEVIATIONS, NAMES, Deviations, unit_priors
from ema_monitor.model.measured import measured_columns
from ema_monitor.model.monitor_model import MonitorModel
from ema_monitor.model.readings import read
from ema_monitor.optimizers.gauss_newton import LeastSquaresProblem, LineSearch, Stopping, descend
from ema_monitor.optimizers.linear_model import Linearisation, Quadratic
from ema_monitor.windows.band import BAND_CORRELATION, band_limited, rms, speed_weight
from ema_monitor.windows.window import Window

# The results below were measured on five simulated units with twelve windows each; sigma is the
# standard deviation of a fitted deviation.
_STEPS: Final = 0.05
"""Step of the difference quotients, relative to 20 sigma of the prior [-].

Steps of 0.02 and 0.1 change the fit by up to 1.6 sigma, because friction is not smooth, and hardly
change the residual of the current."""
_SETTLED: Final = 0.02
"""Step below which a fit has converged [sigma of the prior].

With 0.004, no deviation changes by more than 0.02 sigma. With 0.1, a deviation changes by 1.4
sigma."""
_SHARES: Final = ((1.0,), (0.5,), (0.25,), (0.1,), (0.03,))
"""Step fractions of the line search, tried one after the other, because each requires a run over
all windows. All measured fits took the full step."""
_MOST_ITERATIONS: Final = 100
"""Largest number of iterations; measured fits took at most 7."""
_WORTHWHILE: Final = 0.3
"""Share of the remaining cost that an additional deviation must explain [-]. With 0.15 and 0.6, the
same deviations are selected."""
_NOTABLE: Final = 0.4
"""Minimum size of an additional deviation [sigma of the prior]. With 0.2, one more deviation is
fitted; with 0.8, the residual of the current is up to 12 % larger."""
_ALWAYS_FITTED: Final = ("lift", "friction", "stribeck_speed", "inertia")
_LEAST_NOISE: Final = 1e-2
"""Minimum noise of the current [A]. With 0.005 and 0.02, the fits are the same, because the actual
noise is larger."""


class UnitFit(NamedTuple):
    """Deviations of a unit, ``(25,)``, and their covariance, ``(25, 25)``."""

    deviations: Array
    covariance: Array


class _UnitProblem:
    """Least-squares problem of the deviations: the band-limited mean residual of each command.

    ``x``, ``(d,)``, holds the deviations in the order of ``priors``.
    """

    def __init__(self, groups: Sequence[Sequence[Window]], nominal: MonitorModel) -> None:
        self._groups, self._nominal = groups, nominal
        parameters = nominal.parameters
        self._weights = sample_weights(groups)
        self._h = groups[0][0].sample_period
        self._stiffness = speed_weight(parameters)
        # A current that is not measured has no residual.
        self._current_weight = float(nominal.acquisition.current != "none")
        travel = max(group[0].excitation for group in groups)
        self.priors = unit_priors(parameters, travel, nominal.form)
        self._columns = [NAMES.index(prior.name) for prior in self.priors]
        self.expected, self.sigma, self.lowest, self.highest = np.array(
            [(prior.expected, prior.sigma, prior.lowest, prior.reach) for prior in self.priors]
        ).T
        # A fraction of the prior, but large enough to overcome friction.
        self._steps = _STEPS * np.minimum(20.0 * self.sigma, self.highest)
        self._latest: dict[bytes, Array] = {}
        self.noise = self._noise_at(self.expected)

    def deviations(self, x: Array) -> Array:
        """Return all deviations, ``(..., 25)``, from the fitted deviations ``x``, ``(..., d)``."""
        values = np.zeros((*x.shape[:-1], N_DEVIATIONS))
        values[..., self._columns] = x
        return values

    def covariance(self, covariance_of_x: Array) -> Array:
        """Return the covariance of all deviations, ``(25, 25)``, from the covariance of ``x``."""
        covariance = np.zeros((N_DEVIATIONS, N_DEVIATIONS))
        covariance[np.ix_(self._columns, self._columns)] = covariance_of_x
        return covariance

    def residuals(self, points: Array) -> Array:
        """Return noise-normalised model residuals, followed by prior residuals, ``(m, r + d)``."""
        of_priors = (points - self.expected) / self.sigma
        of_model = np.array([self.model_residuals(x) for x in points]) / self.noise
        return np.concatenate([of_model, of_priors], axis=1)

    def linearise(self, x: Array) -> Linearisation:
        """Return the linearisation at ``x``, and update the noise to its value at ``x``."""
        self._latest = {x.tobytes(): self.model_residuals(x)}
        self.noise = self._noise_at(x)
        [residuals] = self.residuals(x[None])
        jacobian = np.concatenate([-self.slopes(x) / self.noise, np.diag(1.0 / self.sigma)])
        return Linearisation(x, residuals, jacobian)

    def _noise_at(self, x: Array) -> float:
        """Return the noise of a residual at ``x`` [A], increased for correlated neighbours."""
        return math.sqrt(BAND_CORRELATION) * max(rms(self.model_residuals(x)), _LEAST_NOISE)

    def model_residuals(self, x: Array) -> Array:
        """Return band-limited model residuals, averaged over windows per command, ``(r,)`` [A]."""
        key = x.tobytes()
        if key not in self._latest:
            model = self._model(x)
            self._latest[key] = np.concatenate(
                [
                    self._in_band(mean_residuals(group, model, weights))
                    for group, weights in zip(self._groups, self._weights, strict=True)
                ]
            )
        return self._latest[key]

    def slopes(self, x: Array) -> Array:
        """Return the derivatives of the model response with respect to ``x``, ``(r, d)``."""
        up = np.minimum(self._steps, self.highest - x)
        down = np.minimum(self._steps, x - self.lowest)
        sides = self.deviations(np.concatenate([np.diag(up), -np.diag(down)]))
        sides = np.pad(sides, ((0, 0), (0, len(COLUMNS) - N_DEVIATIONS)))
        return self._differences(x, [sides] * len(self._groups)) / (up + down)

    def effects_of_measured(self, x: Array) -> Array:
        """Return the effect of one sigma of each measured cause on the response, ``(r, k)`` [A].

        A sensor is assumed to have the same error in all windows.
        """
        measured = [{cause.name: cause for cause in group[0].measured} for group in self._groups]
        names = sorted({name for by_name in measured for name in by_name})
        sides = []
        for by_name in measured:
            causes_by_name = [[by_name[name]] if name in by_name else [] for name in names]
            errors = [
                [cause._replace(value=cause.sigma) for cause in causes] for causes in causes_by_name
            ]
            above = np.array([measured_columns(causes) for causes in errors])
            above = above.reshape(-1, len(COLUMNS))
            sides.append(np.concatenate([above, -above]))
        if not names:
            return np.zeros((len(self.model_residuals(x)), 0))
        return self._differences(x, sides) / 2.0

    def _differences(self, x: Array, sides: Sequence[Array]) -> Array:
        """Return response differences for pairs of deviations, ``(r, k)`` [A].

        Parameters
        ----------
        x
            Deviations of the model, ``(d,)``.
        sides
            For each command, the ``k`` minuends followed by the ``k`` subtrahends, each in the
            order of `COLUMNS`, ``(2 k, 28)``.
        """
        model, columns = self._model(x), []
        for group, weights, of_group in zip(self._groups, self._weights, sides, strict=True):
            first = group[0]
            faults = np.tile(healthy_faults(), (len(of_group), 1))
            deviations, position = read(of_group + measured_columns(first.measured), first)
            response = model.respond(
                first, faults, place_in_play(first), deviations=deviations, position=position
            )
            pairs = zip(*response, strict=True)
            rows = np.array([self._in_band(np.array(row) * weights) for row in pairs])
            above, below = np.split(rows, 2)
            columns.append((above - below).T)
        return np.concatenate(columns)

    def lowest_of(self, at: Linearisation, active: Flags) -> Array:
        """Return the point within the bounds that minimises the cost of linearised residuals.

        Only the active deviations change.
        """
        x = at.point.copy()
        quadratic = Quadratic.of(at.restricted(x, active))
        x[active] = quadratic.lowest_between(self.lowest[active], self.highest[active])
        return x

    def _model(self, x: Array) -> MonitorModel:
        return self._nominal.of_unit(Deviations.of(self.deviations(x)))

    def _in_band(self, rows: Array) -> Array:
        """Return band-limited current and speed, ``(2, n)``, as one row [A]."""
        current, speed = band_limited(rows, self._h)
        return np.concatenate([self._current_weight * current, self._stiffness * speed])


def fit_unit(groups: Sequence[Sequence[Window]], nominal: MonitorModel) -> UnitFit:
    """Return the deviations of a unit from nominal, fitted to healthy windows.

    The fit uses the Gauss-Newton method on band-limited current and speed. Priors affect only
    deviations that the windows do not determine. The fit begins with lift, friction, Stribeck speed
    and inertia. It adds further deviations one at a time if they explain a large share of the
    remaining residuals. Otherwise they would absorb residuals with different causes.

    Raises
    ------
    ValueError
        If the fit drives a deviation to its bound.
    """
    problem = _UnitProblem(groups, nominal)
    priors, sigma = problem.priors, problem.sigma
    stopping = Stopping(_MOST_ITERATIONS, step=_SETTLED * sigma)
    x = problem.expected
    active = np.array([prior.name in _ALWAYS_FITTED for prior in priors])
    while True:
        search = LineSearch(lambda at: problem.lowest_of(at, active), _SHARES)
        least_squares = LeastSquaresProblem(problem.residuals, problem.linearise)
        descent = descend(least_squares, x[None], search, stopping)
        x, at = descent.point, Quadratic.of(descent.at)
        added = _most_explaining(at, active, _NOTABLE * sigma)
        residuals = problem.model_residuals(x)
        floor = len(residuals) * _LEAST_NOISE**2
        remaining = max(residuals @ residuals, floor) / problem.noise**2
        if added is None or added.gain < _WORTHWHILE * remaining:
            break
        active[added.number] = True
    for prior, value in zip(priors, x, strict=True):
        # The lower bound may be a valid result: viscous friction can be absent.
        if not -prior.reach < value < prior.reach:
            raise ValueError(
                f"the fit drives {prior.name} of the unit to its bound {value:g}: expected about "
                f"{prior.expected:g} ± {prior.sigma:g}; do the parameters belong to this actuator, "
                "and are the units and signs of the columns right?"
            )
    # Deviations that were not fitted may still be present, as far as windows and priors permit.
    normal = at.hessian
    not_fitted = np.where(active, 0.0, np.linalg.solve(normal, at.gradient))
    covariance: Array = np.linalg.inv(normal) + np.diag(not_fitted**2)  # pyright: ignore[reportAssignmentType]
    # The fit assumes exact measured causes; their uncertainty is added here.
    slopes = descent.at.jacobian[: -len(x)]
    shifts = np.linalg.solve(normal, slopes.T @ problem.effects_of_measured(x) / problem.noise)
    return UnitFit(problem.deviations(x), problem.covariance(covariance + shifts @ shifts.T))


class _Addition(NamedTuple):
    """Candidate deviation to add to the fit."""

    number: int
    """Index of the deviation in ``x``."""
    gain: float
    """Reduction of the normalised cost [-]."""


def _most_explaining(at: Quadratic, active: Flags, least: Array) -> _Addition | None:
    """Return the deviation that would reduce the cost the most if it were added to the fit.

    The result is None if no additional deviation would reach the magnitude ``least``, ``(d,)``.
    """
    best = None
    for number in np.flatnonzero(~active):
        trial = active.copy()
        trial[number] = True
        move = np.linalg.solve(at.hessian[np.ix_(trial, trial)], -at.gradient[trial])
        gain = -float(at.gradient[trial] @ move)
        is_notable = abs(move[np.sum(trial[:number])]) >= least[number]
        if is_notable and (best is None or gain > best.gain):
            best = _Addition(int(number), gain)
    return best
