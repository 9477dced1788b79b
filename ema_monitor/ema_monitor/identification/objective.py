"""What an optimizer minimises: the distance of the model from a window, over the unit box."""

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
# The fit of the unit takes the model's mismatch under the calibrated command for noise, which makes
# its covariance too wide there: judged on drawn plants.
CALIBRATED_SHARE = 0.3
# What is not known of the lift of an idle phase, over that of equal phases, and the short circuit
# from which on they are unlike: measured on the reference actuator and on drawn plants.
_LIFT_UNCERTAINTY = 0.2
_UNLIKE_PHASES = 0.1
_MOST_KEPT: Final = 40
# To so many decimals a point that was encoded and decoded again is the same one.
_DECIMALS: Final = 12
# From so many sigma on the columns do not agree as when healthy.
_ODD = 3.0
# Largest step of the difference quotients of a sensor's error, in sigma of its prior.
_SENSOR_DIFFERENCE = 0.2


@dataclass(frozen=True)
class Coordinates:
    """Map between points of the unit box and fault vectors.

    Attributes
    ----------
    play
        Where in its play the motor stands at the window's start [half-widths]; None when it is
        unknown, then it is searched for as a ninth component.
    cartesian
        Whether eccentricity and phase are searched for as ``zeta cos(phi)`` and ``zeta sin(phi)``,
        which are smooth at zero eccentricity, where the phase is undefined.
    hidden
        Hidden causes that are searched for as further components; ``causes`` returns them.
    """

    play: float | None
    cartesian: bool
    hidden: tuple[Prior, ...] = ()

    def decode(self, points: Array) -> tuple[Array, Array]:
        """Return fault vectors, ``(m, 8)``, and places in the play, ``(m,)``, of points.

        An eccentricity beyond 1 is reduced to 1.
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
        """Return the hidden causes of points, ``(..., d)``, in their units, ``(..., n_causes)``."""
        figures = [(one.reach, one.lowest, one.expected) for one in self.hidden]
        reach, lowest, expected = np.reshape(figures, (-1, 3)).T
        first = points.shape[-1] - len(self.hidden)
        return np.maximum(expected + reach * (2.0 * points[..., first:] - 1.0), lowest)

    def encode(self, faults: Array, play: float = 0.0) -> Array:
        """Return the point, ``(d,)``, of a fault vector, ``(8,)``, and a place in the play.

        Hidden causes are what is expected of them there: absent, where they are not measured.
        """
        point = faults.copy()
        if self.cartesian:
            point[PLANE] = (1.0 + eccentricity_vector(faults)) / 2.0
        place = [] if self.play is not None else [(play + 1.0) / 2.0]
        return np.concatenate([point, place, np.full(len(self.hidden), 0.5)])


PLAIN: Final = Coordinates(play=0.0, cartesian=True)
"""Coordinates of the eight faults alone, as `Knowledge` has them."""


class Relations(NamedTuple):
    """What the columns of a window say of each other, whatever moves the actuator (M27).

    Each relation is linear in readings; there may be none.

    Attributes
    ----------
    slopes
        Derivatives by deviations in the order of `COLUMNS`, ``(k, 28)``.
    values, sigmas
        By how much the window differs from a healthy one, and the standard deviations, ``(k,)``.
    """

    slopes: Array = np.zeros((0, len(COLUMNS)))
    values: Array = np.zeros(0)
    sigmas: Array = np.zeros(0)

    @classmethod
    def of(cls, window: Window, calibration: Calibration) -> Self:
        """Return those of a window, as far as they can be judged against healthy ones."""
        parameters = calibration.parameters
        found = []
        travel = travel_ratio(window, parameters)
        if travel is not None and not math.isnan(calibration.travel_ratio):
            found.append((TRAVEL, travel.value / calibration.travel_ratio - 1.0, travel.sigma))
        law = law_offset(window, parameters)
        if law is not None and not math.isnan(calibration.law_offset):
            slopes = law_slopes(parameters)
            found.append((slopes, law.value - calibration.law_offset, law.sigma))
        return cls(*map(np.array, zip(*found, strict=True)))

    def left(self, columns: Array) -> Array:
        """Return what deviations, ``(m, 28)``, leave of them, ``(m, k)``, in sigma of each."""
        return (columns @ self.slopes.T - self.values) / self.sigmas

    @property
    def are_healthy(self) -> bool:
        """Whether the columns agree as when healthy."""
        return bool(np.all(np.abs(self.values) < _ODD * self.sigmas))


class Objective:
    """Residuals of a calibrated model in a window, as a function on the unit box.

    Parameters
    ----------
    window
        The window; hidden causes that were measured have their values in every response.
    calibration
        Calibration of the model; it has as many samples as the window.
    fitness
        Name of the distance that is minimised.
    cartesian
        As of `Coordinates`.
    causes
        Hidden causes that are further components; their priors are further residuals.
    known
        What is known of the faults already: eight more residuals. None where nothing is.

    Attributes
    ----------
    fitness
        The distance that is minimised.
    healthy
        The healthy point, ``(d,)``.
    encode, decode
        Of its `Coordinates`.
    hidden_causes
        Hidden causes that are components.
    known
        What is known of the faults already; None where nothing is.
    relations
        What the columns say of each other, where readings of the position are components.
    first_cause
        Number of the first component that is a hidden cause.
    scatter
        Rms of the residual of current and speed in a healthy window of this command [A, rad/s].
    """

    def __init__(
        self,
        window: Window,
        calibration: Calibration,
        fitness: str = DEFAULT_FITNESS,
        *,
        cartesian: bool = True,
        causes: tuple[Prior, ...] = (),
        known: Knowledge | None = None,
    ) -> None:
        self._window, self._calibration = window, calibration
        # Laying one command over another takes time: once a window.
        self._knows, self._corrections, self.scatter = calibration.reference(window)
        self._model = calibration.model()
        self.fitness = FITNESS[fitness](window, calibration, self.scatter)
        # The latest responses, by what moves the model, and how many there were.
        self._responses: list[dict[bytes, tuple[Array, Array]]] = [{}]
        self._counts = Counter[str]()
        self._measured = measured_columns(window.measured)
        self.known = known
        self._known_rows = np.zeros((0, N_FAULTS))
        if known is not None:
            self._known_rows = math.sqrt(self.noise) * known.rows()
        self._take(causes, cartesian)

    def _take(self, causes: tuple[Prior, ...], cartesian: bool) -> None:
        self._coordinates = Coordinates(self._window.play, cartesian, causes)
        self.encode, self.decode = self._coordinates.encode, self._coordinates.decode
        self.hidden_causes = causes
        self._columns = [COLUMNS.index(one.name) for one in causes]
        self._sigmas = np.array([2.0 * one.reach / one.sigma for one in causes])
        self._tails = np.array([one.tail for one in causes])
        # The reach of a sensor's error is wide: a share of it would be more than the noise.
        largest = np.where(np.isfinite(self._tails), _SENSOR_DIFFERENCE / self._sigmas, np.inf)
        of_causes = np.minimum(DIFFERENCE, largest)
        self.relations = Relations()
        if {one.name for one in causes} >= set(MOVES_START):
            self.relations = Relations.of(self._window, self._calibration)
        self.healthy = self.encode(healthy_faults())
        self.first_cause = len(self.healthy) - len(causes)
        self._differences = np.append(np.full(self.first_cause, DIFFERENCE), of_causes)
        # They are linear in a point, and are asked for at many.
        relations, reaches = self.relations, np.array([2.0 * one.reach for one in causes])
        self._unrelated = relations.left(self._deviations(self.healthy[None]))[0]
        self._related = relations.slopes[:, self._columns] * reaches / relations.sigmas[:, None]

    def with_causes(self, causes: tuple[Prior, ...], *, cartesian: bool) -> Self:
        """Return the same with other hidden causes as components; it shares the responses."""
        other = copy(self)
        other._take(causes, cartesian)
        return other

    def fair_cost(self) -> float:
        """Return the cost of an optimum that explains most of the departure from healthy [A^2.s].

        Where the model does not match the unit, no optimum is a good one.
        """
        [at_healthy] = self.residuals(self.healthy[None])
        return max(self.fitness.good_cost, _UNEXPLAINED_POWER * float(at_healthy @ at_healthy))

    @property
    def dimension(self) -> int:
        """Number of components of a point: eight, and the place in the play where unknown."""
        return len(self.healthy)

    @property
    def evaluations(self) -> int:
        """Number of windows of the model that were computed so far, of `with_causes` as well."""
        return self._counts["runs"]

    @property
    def linearisation_evaluations(self) -> int:
        """Number of model evaluations that `linearise` takes."""
        # Those of sensors take no run of the model of their own.
        free = (*NAMES[-N_SENSOR:], "command_delay")
        return 2 * (self.dimension - sum(one.name in free for one in self.hidden_causes)) + 1

    @property
    def unit_evaluations(self) -> int:
        """Number of model evaluations that `unit_effects` takes."""
        steps = len(self.unit_steps)
        return (2 if self._knows and steps else 1) * (1 + steps)

    @property
    def noise(self) -> float:
        """Cost that noise adds per effective residual [A^2.s], the variance of a prior's residual.

        It is that of a healthy window, times the square of the misfit of what is known already.
        """
        misfit = 1.0 if self.known is None else self.known.misfit
        return misfit**2 * self.fitness.noise

    def misfit(self, residuals: Array) -> float:
        """Return how many times larger than when healthy residuals, ``(r,)``, are."""
        return math.sqrt(
            self.window_cost(residuals) / (self.fitness.noise * self.fitness.effective)
        )

    def window_cost(self, residuals: Array) -> float:
        """Return the sum of squares of residuals, ``(r,)``, but for priors [A^2.s]."""
        of_window = residuals[: len(residuals) - self.priors]
        return float(of_window @ of_window)

    def covariance(self, jacobian: Array, residuals: Array) -> Array:
        """Return the covariance of the components whose derivatives the Jacobian has."""
        lags = max(1, round(CORRELATION_S / self.fitness.spacing))
        return sandwich_covariance(jacobian, residuals, lags, self.priors, self.noise)

    @property
    def priors(self) -> int:
        """Number of residuals, the last ones, that are priors."""
        return len(self.relations.values) + len(self._known_rows) + len(self._sigmas)

    def surprise(self, point: Array) -> Array:
        """Return how unusual the hidden causes of points, ``(..., d)``, are, ``(...)``.

        It is what their priors, and the relations of the columns, have in the cost over ``noise``.
        """
        left = (point[..., self.first_cause :] - 0.5) @ self._related.T + self._unrelated
        return np.sum(self._unusual(point) ** 2, axis=-1) + np.sum(left**2, axis=-1)

    def _unusual(self, point: Array) -> Array:
        """Return residuals of unit variance by the priors of hidden causes, ``(..., n_causes)``.

        Their squares are -2 ln of the density over the highest one: normal up to the tail, a power
        law beyond, with a continuous slope.
        """
        away = self.cause_sigmas(point)
        distances = np.abs(away)
        if np.any(is_far := distances > self._tails):
            tails = np.broadcast_to(self._tails, away.shape)[is_far]
            lengths = tails * np.sqrt(1.0 + 2.0 * np.log(distances[is_far] / tails))
            away[is_far] = np.copysign(lengths, away[is_far])
        return away

    def cause_sigmas(self, point: Array) -> Array:
        """Return how many sigma hidden causes are from what is expected, ``(..., n_causes)``."""
        return self._sigmas * (point[..., self.first_cause :] - 0.5)

    @property
    def known_rows(self) -> slice:
        """Which residuals, counted from the last one, are those of what is known already."""
        last = len(self._sigmas)
        return slice(-(len(self._known_rows) + last), -last or None)

    @property
    def surprising_rows(self) -> NDArray[np.int64]:
        """Which residuals, counted from the last one, are those of `surprise`."""
        last, known = len(self._sigmas), len(self._known_rows)
        of_relations = np.arange(-self.priors, -(known + last))
        return np.concatenate([of_relations, np.arange(-last, 0)])

    def causes(self, points: Array) -> Array:
        """Return the hidden causes of points, ``(..., d)``, in their units, ``(..., n_causes)``."""
        return self._coordinates.causes(points)

    def _deviations(self, points: Array) -> Array:
        """Return the columns at points, ``(m, 28)``: the measured ones and the components."""
        deviations = np.tile(self._measured, (len(points), 1))
        if self._columns:
            deviations[:, self._columns] = self._coordinates.causes(points)
        return deviations

    def expect(self, points: Array) -> Response:
        """Return the calibrated response at points of the unit box, ``(m, d)``."""
        return self._respond(*self.decode(points), self._deviations(points))

    def _respond(self, faults: Array, play: Array, columns: Array) -> Response:
        """Return the responses with deviations in the order of `COLUMNS`, ``(m, 28)``.

        A sensor's error takes no run of the model of its own, nor does what was run lately.
        """
        deviations, position = read(columns, self._window)
        of_sensors = deviations[:, -N_SENSOR:].copy()
        deviations[:, -N_SENSOR:] = 0.0
        moving = np.concatenate([faults, play[:, None], deviations, position[:, None]], axis=1)
        # Threads may share an objective: each goes on with what it has found.
        known = dict(self._responses[0])
        keys = [row.tobytes() for row in np.round(moving, _DECIMALS) + 0.0]
        new = list({key: row for row, key in enumerate(keys) if key not in known}.values())
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
            known.update(zip([keys[row] for row in new], zip(*model, strict=True), strict=True))
        current, speed = map(np.array, zip(*[known[key] for key in keys], strict=True))
        # The first is where the search begins, mostly the healthy point: it is asked for again.
        first, *others = known.items()
        self._responses[0] = dict([first, *others[-_MOST_KEPT:]])
        if len(seen := np.flatnonzero(np.any(of_sensors, axis=1))):
            rows = current[seen], speed[seen]
            current[seen], speed[seen] = sensed(rows, of_sensors[seen], self._window.sample_period)
        return Response(current, speed)

    def unit_effects(self, point: Array) -> Array:
        """Return what is not known of the unit does to the residuals, ``(r, k)``.

        A column is the effect of one standard deviation along a principal axis of the covariance of
        its deviations. Under the calibrated command, a deviation does not change the healthy
        response, which is measured: its effect there is taken off. With six steps, three more
        columns are those of the idle phases' lift, not known once the phases differ.
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
        if self.known is not None and self.known.shifts.size:
            # What is known already has been shifted by the same deviations of the unit.
            end = len(effects) - len(self._sigmas)
            effects[end - N_FAULTS : end] = -self._known_rows @ self.known.shifts
        return effects

    def _with_lift(self, faults: Array, current: Array, speed: Array) -> Array:
        """Return the residuals with more lift of each idle phase than is expected, ``(3, r)``."""
        from ema_monitor.model.drives import lifts_of_pairs  # with the compiler

        parameters = self._calibration.parameters
        unlike = min(1.0, float(np.max(faults[SHORT_CIRCUITS])) / _UNLIKE_PHASES)
        sigma = unlike * _LIFT_UNCERTAINTY * parameters.h_b / 4.0
        lifts = lifts_of_pairs(parameters, self._window.telemetry.position[1:], current)
        return self.fitness.residuals(Response(current + sigma * lifts, np.tile(speed, (3, 1))))

    @cached_property
    def unit_steps(self) -> Array:
        """Return a standard deviation of the unit along each principal axis, ``(k, 25)``."""
        covariance = self._calibration.unit_covariance
        if self._knows:
            # What was not worth fitting is in the correction, but for the play, which hardly shows
            # when healthy and of which a fault is a multiple.
            shares = np.where(self._calibration.unit, CALIBRATED_SHARE, 0.0)
            shares[[NAMES.index("backlash"), NAMES.index("loop_delay")]] = 1.0
            covariance = covariance * np.outer(shares, shares)
        fitted = np.flatnonzero(np.diag(covariance))
        variances, axes = np.linalg.eigh(covariance[np.ix_(fitted, fitted)])
        steps = np.zeros((len(fitted), N_DEVIATIONS))
        steps[:, fitted] = (axes * np.sqrt(np.maximum(variances, 0.0))).T
        return steps

    def residuals(self, points: Array) -> Array:
        """Return the residuals at points, ``(m, d)``: ``(m, r)`` [A.s^(1/2)]."""
        of_causes = points[:, self.first_cause :] - 0.5
        unrelated = math.sqrt(self.noise) * (of_causes @ self._related.T + self._unrelated)
        rows = [self.fitness.residuals(self.expect(points)), unrelated]
        if self.known is not None:
            rows.append((points[:, :N_FAULTS] - self.known.point) @ self._known_rows.T)
        rows.append(math.sqrt(self.noise) * self._unusual(points))
        return np.concatenate(rows, axis=1)

    def linearise(self, point: Array, free: Flags | None = None) -> Linearisation:
        """Return residuals and their central differences at a point, ``(d,)``.

        The derivatives of components that are not ``free``, ``(d,)``, are 0.
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
        """Return a linearisation with derivatives of the ``free``, where they are missing."""
        missing = free & ~np.any(at.jacobian, axis=0)
        if not np.any(missing):
            return at
        more = self.linearise(at.point, missing)
        return more._replace(jacobian=np.where(missing, more.jacobian, at.jacobian))
