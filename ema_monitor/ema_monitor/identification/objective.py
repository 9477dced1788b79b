# SPDX-License-Identifier: Apache-2.0
"""Objective of a search: distance between model and window, for points in a unit box."""

import math
from collections import Counter
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array, Flags
from ema_core.faults import (
    HIGHEST,
    N_FAULTS,
    SHORT_CIRCUITS,
    eccentricity_vector,
    healthy_faults,
    with_eccentricity,
)
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.fitness import DEFAULT_FITNESS, FITNESS
from ema_monitor.identification.knowledge import Knowledge
from ema_monitor.identification.uncertainty import CORRELATION_S, PLANE, sandwich_covariance
from ema_monitor.model.deviations import COLUMNS, N_DEVIATIONS, N_SENSOR, NAMES, Prior, sensed
from ema_monitor.model.measured import measured_columns
from ema_monitor.model.monitor_model import Response
from ema_monitor.model.readings import MOVES_START, TRAVEL, law_slopes, read
from ema_monitor.optimizers.least_squares import DIFFERENCE
from ema_monitor.optimizers.linear_model import Linearisation
from ema_monitor.windows.relations import law_offset, travel_ratio
from ema_monitor.windows.window import Window

_UNEXPLAINED_POWER = 0.05
CALIBRATED_SHARE = 0.3
"""Share of the fitted deviations' standard deviation that applies to the calibrated command [-].

The fit of the unit treats the model mismatch under this command as noise. Therefore its covariance
is too large for this command. The share was determined on simulated units.
"""

# Uncertainty of the lift of an idle phase relative to the lift with equal phases, and the short
# circuit above which the phases count as unequal. Measured on the reference actuator and on
# simulated units.
_LIFT_UNCERTAINTY = 0.2
_UNLIKE_PHASES = 0.1
_MOST_KEPT: Final = 40
# Number of decimals to which points are compared: encoding and decoding change later decimals.
_DECIMALS: Final = 12
# Distance beyond which the columns of a window are inconsistent [sigma].
_ODD = 3.0
# Largest step of the difference quotients of a sensor error [sigma of its prior].
_SENSOR_DIFFERENCE = 0.2


@dataclass(frozen=True)
class Coordinates:
    """Map between points of the unit box and fault vectors."""

    play: float | None
    """Position of the motor in its play at the start of the window [half-widths]. If None, it is
    unknown and becomes a ninth component of the search."""
    cartesian: bool
    """Whether the components of the eccentricity are ``zeta cos(phi)`` and ``zeta sin(phi)``, which
    are smooth at zero eccentricity, where the phase is undefined."""
    hidden: tuple[Prior, ...] = ()
    """Hidden causes that are additional components; ``causes`` returns their values."""

    def decode(self, points: Array) -> tuple[Array, Array]:
        """Return the fault vectors, ``(m, 8)``, and positions in the play, ``(m,)``, at points.

        An eccentricity above 1 is limited to 1.
        """
        faults = points[:, :N_FAULTS]
        if self.cartesian:
            faults = with_eccentricity(faults, (2.0 * points[:, PLANE] - 1.0).T)
        if self.play is None:
            play = 2.0 * points[:, N_FAULTS] - 1.0
        else:
            play = np.full(len(points), self.play)
        return np.minimum(faults, HIGHEST), play

    def causes(self, points: Array) -> Array:
        """Return the hidden causes at points, ``(..., d)``, in their units, ``(..., n_causes)``."""
        figures = [(prior.reach, prior.lowest, prior.expected) for prior in self.hidden]
        reach, lowest, expected = np.reshape(figures, (-1, 3)).T
        first = points.shape[-1] - len(self.hidden)
        return np.maximum(expected + reach * (2.0 * points[..., first:] - 1.0), lowest)

    def encode(self, faults: Array, play: float = 0.0) -> Array:
        """Return the point, ``(d,)``, for a fault vector, ``(8,)``, and a position in the play.

        Hidden causes have their expected values: 0 unless they are measured.
        """
        point = faults.copy()
        if self.cartesian:
            point[PLANE] = (1.0 + eccentricity_vector(faults)) / 2.0
        place = [] if self.play is not None else [(play + 1.0) / 2.0]
        return np.concatenate([point, place, np.full(len(self.hidden), 0.5)])


PLAIN: Final = Coordinates(play=0.0, cartesian=True)
"""Coordinates of the eight faults alone, as in `Knowledge`."""


class Relations(NamedTuple):
    """Relations between the columns of a window that hold for any motion.

    Each relation is linear in the errors of the readings. The number of relations may be 0.
    """

    slopes: Array = np.zeros((0, len(COLUMNS)))
    """Derivatives with respect to the deviations in the order of `COLUMNS`, ``(k, 28)``."""
    values: Array = np.zeros(0)
    """Differences between the window and a healthy window, ``(k,)``."""
    sigmas: Array = np.zeros(0)
    """Standard deviations of the differences, ``(k,)``."""

    @classmethod
    def of(cls, window: Window, calibration: Calibration) -> Self:
        """Return the relations in a window for which the calibration has healthy values."""
        parameters = calibration.parameters
        relations = []
        travel = travel_ratio(window, parameters)
        if travel is not None and not math.isnan(calibration.travel_ratio):
            relations.append((TRAVEL, travel.value / calibration.travel_ratio - 1.0, travel.sigma))
        law = law_offset(window, parameters)
        if law is not None and not math.isnan(calibration.law_offset):
            slopes = law_slopes(parameters)
            relations.append((slopes, law.value - calibration.law_offset, law.sigma))
        return cls(*map(np.array, zip(*relations, strict=True)))

    def residuals(self, columns: Array) -> Array:
        """Return residuals of the relations, ``(m, k)`` [sigma], for deviations, ``(m, 28)``."""
        return (columns @ self.slopes.T - self.values) / self.sigmas

    @property
    def are_healthy(self) -> bool:
        """Whether the columns are as consistent as in a healthy window."""
        return bool(np.all(np.abs(self.values) < _ODD * self.sigmas))


class Objective:
    """Residuals of a calibrated model in a window, as a function of points in the unit box.

    Parameters
    ----------
    window
        The window. Its measured hidden causes are included in every response.
    calibration
        Calibration of the model.
    fitness
        Name of the distance measure to minimise.
    cartesian
        Whether the components of the eccentricity are Cartesian; see `Coordinates`.
    causes
        Hidden causes that are additional components. Their priors are additional residuals.
    knowledge
        Prior knowledge of the faults, which adds eight residuals, or None.

    Attributes
    ----------
    fitness
        Distance measure to minimise.
    healthy
        The healthy point, ``(d,)``.
    encode, decode
        Maps between points and fault vectors; see `Coordinates`.
    hidden_causes
        Hidden causes that are components.
    knowledge
        Prior knowledge of the faults, or None.
    relations
        Relations between the columns; empty unless errors of the position are components.
    first_cause
        Index of the first component that is a hidden cause.
    scatter
        Rms residuals of current and speed in a healthy window with the same command [A, rad/s].
    """

    def __init__(
        self,
        window: Window,
        calibration: Calibration,
        fitness: str = DEFAULT_FITNESS,
        *,
        cartesian: bool = True,
        causes: tuple[Prior, ...] = (),
        knowledge: Knowledge | None = None,
    ) -> None:
        self._window, self._calibration = window, calibration
        # Aligning two commands is slow, and therefore done only once per window.
        self._knows, self._corrections, self.scatter = calibration.reference(window)
        self._model = calibration.model()
        self.fitness = FITNESS[fitness](window, calibration, self.scatter)
        # Recent responses by the inputs of the model, and the number of model evaluations.
        self._responses: list[dict[bytes, tuple[Array, Array]]] = [{}]
        self._counts = Counter[str]()
        self._measured = measured_columns(window.measured)
        self.knowledge = knowledge
        self._knowledge_rows = np.zeros((0, N_FAULTS))
        if knowledge is not None:
            self._knowledge_rows = math.sqrt(self.noise) * knowledge.rows()
        self._set_causes(causes, cartesian)

    def _set_causes(self, causes: tuple[Prior, ...], cartesian: bool) -> None:
        self._coordinates = Coordinates(self._window.play, cartesian, causes)
        self.encode, self.decode = self._coordinates.encode, self._coordinates.decode
        self.hidden_causes = causes
        self._columns = [COLUMNS.index(prior.name) for prior in causes]
        self._sigmas = np.array([2.0 * prior.reach / prior.sigma for prior in causes])
        self._tails = np.array([prior.tail for prior in causes])
        # A sensor error has a wide range: a fixed share of the range would exceed the noise.
        largest = np.where(np.isfinite(self._tails), _SENSOR_DIFFERENCE / self._sigmas, np.inf)
        of_causes = np.minimum(DIFFERENCE, largest)
        self.relations = Relations()
        if {prior.name for prior in causes} >= set(MOVES_START):
            self.relations = Relations.of(self._window, self._calibration)
        self.healthy = self.encode(healthy_faults())
        self.first_cause = len(self.healthy) - len(causes)
        self._differences = np.append(np.full(self.first_cause, DIFFERENCE), of_causes)
        # The relations are linear in a point: their coefficients are valid for all evaluations.
        relations, reaches = self.relations, np.array([2.0 * prior.reach for prior in causes])
        self._unrelated = relations.residuals(self._deviations(self.healthy[None]))[0]
        self._related = relations.slopes[:, self._columns] * reaches / relations.sigmas[:, None]

    def with_causes(self, causes: tuple[Prior, ...], *, cartesian: bool) -> Self:
        """Return the objective with different hidden causes as components.

        Both objectives share their responses and the count of evaluations.
        """
        objective = copy(self)
        objective._set_causes(causes, cartesian)
        return objective

    def fair_cost(self) -> float:
        """Return the highest cost at which an optimum explains most of the departure [A^2.s].

        It is 5 % of the cost at the healthy point, but at least the good cost.

        It replaces the good cost for units that the model does not match: all their optima have a
        high cost.
        """
        [at_healthy] = self.residuals(self.healthy[None])
        return max(self.fitness.good_cost, _UNEXPLAINED_POWER * float(at_healthy @ at_healthy))

    @property
    def dimension(self) -> int:
        """Number of components of a point: faults, unknown position in the play, hidden causes."""
        return len(self.healthy)

    @property
    def evaluations(self) -> int:
        """Number of model evaluations so far, including objectives from `with_causes`."""
        return self._counts["runs"]

    @property
    def linearisation_evaluations(self) -> int:
        """Number of model evaluations in `linearise`."""
        # Sensor errors need no model evaluation of their own.
        free = (*NAMES[-N_SENSOR:], "command_delay")
        return 2 * (self.dimension - sum(prior.name in free for prior in self.hidden_causes)) + 1

    @property
    def unit_evaluations(self) -> int:
        """Number of model evaluations in `unit_effects`."""
        steps = len(self.unit_steps)
        return (2 if self._knows and steps else 1) * (1 + steps)

    @property
    def noise(self) -> float:
        """Noise per effective residual, which is also the variance of a prior residual [A^2.s].

        It is the noise of a healthy window times the squared misfit of the prior knowledge.
        """
        misfit = 1.0 if self.knowledge is None else self.knowledge.misfit
        return misfit**2 * self.fitness.noise

    def misfit(self, residuals: Array) -> float:
        """Return the rms of residuals, ``(r,)``, relative to the rms in a healthy window [-]."""
        return math.sqrt(
            self.window_cost(residuals) / (self.fitness.noise * self.fitness.effective)
        )

    def window_cost(self, residuals: Array) -> float:
        """Return the sum of squares of residuals, ``(r,)``, without prior residuals [A^2.s]."""
        of_window = residuals[: len(residuals) - self.priors]
        return float(of_window @ of_window)

    def covariance(self, jacobian: Array, residuals: Array) -> Array:
        """Return the covariance of the components in the columns of a Jacobian, ``(d, d)``."""
        lags = max(1, round(CORRELATION_S / self.fitness.spacing))
        return sandwich_covariance(jacobian, residuals, lags, self.priors, self.noise)

    @property
    def priors(self) -> int:
        """Number of prior residuals, which come last in a row of residuals."""
        return len(self.relations.values) + len(self._knowledge_rows) + len(self._sigmas)

    def surprise(self, point: Array) -> Array:
        """Return the surprise, ``(...)``, of the hidden causes at points, ``(..., d)``.

        It is the part of the cost due to their priors and the relations, divided by ``noise``.
        """
        relation_residuals = (
            point[..., self.first_cause :] - 0.5
        ) @ self._related.T + self._unrelated
        return np.sum(self._unusual(point) ** 2, axis=-1) + np.sum(relation_residuals**2, axis=-1)

    def _unusual(self, point: Array) -> Array:
        """Return the prior residuals of hidden causes with unit variance, ``(..., n_causes)``.

        Their squares are -2 ln of the density relative to its maximum. The density is normal up to
        the tail and a power law beyond, with a continuous slope.
        """
        offsets = self.cause_sigmas(point)
        distances = np.abs(offsets)
        if np.any(is_far := distances > self._tails):
            tails = np.broadcast_to(self._tails, offsets.shape)[is_far]
            lengths = tails * np.sqrt(1.0 + 2.0 * np.log(distances[is_far] / tails))
            offsets[is_far] = np.copysign(lengths, offsets[is_far])
        return offsets

    def cause_sigmas(self, point: Array) -> Array:
        """Return the distances of hidden causes from their priors, ``(..., n_causes)`` [sigma]."""
        return self._sigmas * (point[..., self.first_cause :] - 0.5)

    @property
    def knowledge_rows(self) -> slice:
        """Positions of the residuals of the prior knowledge, from the end of a row."""
        last = len(self._sigmas)
        return slice(-(len(self._knowledge_rows) + last), -last or None)

    @property
    def surprising_rows(self) -> NDArray[np.int64]:
        """Positions of the residuals that `surprise` includes, from the end of a row."""
        last, before = len(self._sigmas), len(self._knowledge_rows)
        of_relations = np.arange(-self.priors, -(before + last))
        return np.concatenate([of_relations, np.arange(-last, 0)])

    def causes(self, points: Array) -> Array:
        """Return the hidden causes at points, ``(..., d)``, in their units, ``(..., n_causes)``."""
        return self._coordinates.causes(points)

    def _deviations(self, points: Array) -> Array:
        """Return the deviations at points: measured causes and components, ``(m, 28)``."""
        deviations = np.tile(self._measured, (len(points), 1))
        if self._columns:
            deviations[:, self._columns] = self._coordinates.causes(points)
        return deviations

    def expect(self, points: Array) -> Response:
        """Return the calibrated response at points of the unit box, ``(m, d)``."""
        return self._respond(*self.decode(points), self._deviations(points))

    def _respond(self, faults: Array, play: Array, columns: Array) -> Response:
        """Return the responses for faults, positions in the play and deviations, ``(m, 28)``.

        Sensor errors and recent points require no model evaluation.
        """
        deviations, position = read(columns, self._window)
        of_sensors = deviations[:, -N_SENSOR:].copy()
        deviations[:, -N_SENSOR:] = 0.0
        moving = np.concatenate([faults, play[:, None], deviations, position[:, None]], axis=1)
        # Threads may share an objective: each thread uses its own copy of the cache.
        cache = dict(self._responses[0])
        keys = [row.tobytes() for row in np.round(moving, _DECIMALS) + 0.0]
        new = list({key: row for row, key in enumerate(keys) if key not in cache}.values())
        if new:
            model = self._model.respond(
                self._window,
                faults[new],
                play[new],
                self._corrections,
                deviations[new],
                position[new],
            )
            self._counts["runs"] += len(new)
            cache.update(zip([keys[row] for row in new], zip(*model, strict=True), strict=True))
        current, speed = map(np.array, zip(*[cache[key] for key in keys], strict=True))
        # The first point is the start of the search, which is often the healthy point: keep it.
        first, *recent = cache.items()
        self._responses[0] = dict([first, *recent[-_MOST_KEPT:]])
        if len(seen := np.flatnonzero(np.any(of_sensors, axis=1))):
            rows = current[seen], speed[seen]
            current[seen], speed[seen] = sensed(rows, of_sensors[seen], self._window.sample_period)
        return Response(current, speed)

    def unit_effects(self, point: Array) -> Array:
        """Return the effects of the unit's uncertain deviations on the residuals, ``(r, k)``.

        Each column is the effect of one standard deviation along a principal axis of the covariance
        of the deviations. For the calibrated command, the healthy response was measured, so that
        the effect on the healthy response is subtracted. A six-step drive has three more columns
        for the lift of the idle phases, which is uncertain if the phases differ.
        """
        steps = self.unit_steps
        bases = np.stack([point, self.healthy]) if self._knows and len(steps) else point[None]
        faults, play = self.decode(bases)
        varied = np.zeros((1 + len(steps), len(COLUMNS)))
        varied[1:, :N_DEVIATIONS] = steps
        m = len(varied)
        columns = np.concatenate([self._deviations(point[None]) + varied, varied][: len(bases)])
        response = self._respond(np.repeat(faults, m, axis=0), np.repeat(play, m), columns)
        rows = self.fitness.residuals(response).reshape(len(bases), m, -1)
        effects = rows[0, 1:] - rows[0, 0]
        if len(bases) > 1:
            effects -= rows[1, 1:] - rows[1, 0]
        # A drive without idle phases has no lift.
        if self._calibration.drive == "six_step":
            lifted = self._with_lift(faults[0], response.current[0], response.speed[0])
            effects = np.concatenate([effects, lifted - rows[0, 0]])
        effects = np.pad(effects.T, ((0, self.priors), (0, 0)))
        if self.knowledge is not None and self.knowledge.shifts.size:
            # The same deviations of the unit have shifted the prior knowledge.
            end = len(effects) - len(self._sigmas)
            effects[end - N_FAULTS : end] = -self._knowledge_rows @ self.knowledge.shifts
        return effects

    def _with_lift(self, faults: Array, current: Array, speed: Array) -> Array:
        """Return the residuals after a one-sigma increase of each idle phase's lift, ``(3, r)``."""
        from ema_monitor.model.drives import lifts_of_pairs  # with the compiler

        parameters = self._calibration.parameters
        unlike = min(1.0, float(np.max(faults[SHORT_CIRCUITS])) / _UNLIKE_PHASES)
        sigma = unlike * _LIFT_UNCERTAINTY * parameters.h_b / 4.0
        lifts = lifts_of_pairs(parameters, self._window.telemetry.position[1:], current)
        return self.fitness.residuals(Response(current + sigma * lifts, np.tile(speed, (3, 1))))

    @cached_property
    def unit_steps(self) -> Array:
        """Uncertain deviations of the unit, by one sigma along each principal axis, ``(k, 25)``."""
        covariance = self._calibration.unit_covariance
        if self._knows:
            # The correction includes the deviations that were not worth fitting, except the play:
            # it has little effect in a healthy window, and a backlash fault is a multiple of it.
            shares = np.where(self._calibration.unit, CALIBRATED_SHARE, 0.0)
            shares[[NAMES.index("backlash"), NAMES.index("loop_delay")]] = 1.0
            covariance = covariance * np.outer(shares, shares)
        fitted = np.flatnonzero(np.diag(covariance))
        variances, axes = np.linalg.eigh(covariance[np.ix_(fitted, fitted)])
        steps = np.zeros((len(fitted), N_DEVIATIONS))
        steps[:, fitted] = (axes * np.sqrt(np.maximum(variances, 0.0))).T
        return steps

    def residuals(self, points: Array) -> Array:
        """Return the residuals, ``(m, r)`` [A.s^(1/2)], at points, ``(m, d)``."""
        of_causes = points[:, self.first_cause :] - 0.5
        unrelated = math.sqrt(self.noise) * (of_causes @ self._related.T + self._unrelated)
        rows = [self.fitness.residuals(self.expect(points)), unrelated]
        if self.knowledge is not None:
            rows.append((points[:, :N_FAULTS] - self.knowledge.point) @ self._knowledge_rows.T)
        rows.append(math.sqrt(self.noise) * self._unusual(points))
        return np.concatenate(rows, axis=1)

    def linearise(self, point: Array, free: Flags | None = None) -> Linearisation:
        """Return the linearisation of the residuals at a point, ``(d,)``, by central differences.

        Derivatives with respect to components that are not ``free``, ``(d,)``, are 0.
        """
        free = np.ones(len(point), dtype=bool) if free is None else free
        steps = np.diag(self._differences)[free]
        below, above = np.maximum(point - steps, 0.0), np.minimum(point + steps, 1.0)
        rows = self.residuals(np.concatenate([point[None], below, above]))
        at_point, at_below, at_above = np.split(rows, [1, 1 + len(steps)])
        jacobian = np.zeros((rows.shape[1], len(point)))
        jacobian[:, free] = (at_above - at_below).T / np.sum(above - below, axis=1)
        return Linearisation(point, at_point[0], jacobian)

    def extended(self, at: Linearisation, free: Flags) -> Linearisation:
        """Return a linearisation with missing derivatives of ``free`` components added."""
        missing = free & ~np.any(at.jacobian, axis=0)
        if not np.any(missing):
            return at
        more = self.linearise(at.point, missing)
        return more._replace(jacobian=np.where(missing, more.jacobian, at.jacobian))
