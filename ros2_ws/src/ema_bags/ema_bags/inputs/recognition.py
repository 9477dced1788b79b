# SPDX-License-Identifier: Apache-2.0
"""Identification of joint positions, speeds, efforts and commands in a log, from physics.

The speed is the derivative of the position, the position follows the command, and the effort is the
sum of inertia, friction and gravity. Column names corroborate, or break ties.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.units import ANGLES, SPEEDS

_MOST_ROWS: Final = 40_000
_LEAST_ROWS: Final = 50
_LEAST_DISTINCT: Final = 4
_STEP_S: Final = 0.005
# Time constant of the low-pass filter [s], and its lower limit in samples.
_SMOOTH_S: Final = 0.03
_SMOOTH_SAMPLES: Final = 2.0
# Largest lag at which columns are compared [s], and as a fraction of the motion's period.
_LAG_S: Final = 0.5
_LAG_SHARE: Final = 1.0 / 8.0
_RATE: Final = 0.8
_SURE_RATE: Final = 0.95
_FOLLOWS: Final = 0.9
_EXPLAINED: Final = 0.3
_ALIKE: Final = 0.1
_LEAST_SCORE: Final = 0.8
_SAME: Final = 0.985
_UNIT_TOLERANCE: Final = 0.04
_BLOCKS: Final = 10
_FRICTION_SPEED: Final = 0.02


class Hint(NamedTuple):
    """Quantity of a column as suggested by its name."""

    quantities: frozenset[str]
    """Quantities that the name suggests; empty if it suggests none."""

    is_commanded: bool = False
    """Whether the name suggests a commanded value."""

    def supports(self, quantity: str) -> float:
        """Return 1 if the name suggests the quantity, -1 if only others, 0 if none."""
        if not self.quantities:
            return 0.0
        return 1.0 if quantity in self.quantities else -1.0


class IdentifiedColumn(NamedTuple):
    """Column identified for a quantity."""

    name: str
    """Column name."""

    is_confirmed: bool
    """Whether the motion confirms the choice, rather than the name alone."""


@dataclass(frozen=True)
class JointColumns:
    """Columns identified for one joint."""

    columns: Mapping[str, IdentifiedColumn]
    """Columns by quantity: ``position``, ``command``, ``speed``, ``effort``."""


_RATE_RATIOS: Final = np.array(
    [
        1.0,  # rad, deg, turns or mm, and the same per second
        SPEEDS["rad/s"] / SPEEDS["deg/s"],
        SPEEDS["deg/s"] / SPEEDS["rad/s"],
        SPEEDS["rad/s"] / SPEEDS["rpm"],
        SPEEDS["deg/s"] / SPEEDS["rpm"],
        SPEEDS["turn/s"] / SPEEDS["rpm"],
        SPEEDS["turn/s"] / SPEEDS["rad/s"],
        1e3,  # m and mm/s
        1e-3,
    ]
)
"""Ratios of speed to position derivative for common pairs of units."""
_COPY_RATIOS: Final = np.array([1.0, ANGLES["rad"] / ANGLES["deg"], ANGLES["deg"], 1e3, 1e-3])
"""Ratios of position to command for common pairs of units."""


class _Relation(NamedTuple):
    """How well one column predicts another."""

    correlation: float
    """Correlation at the best lag [-]."""

    ratio: float
    """Ratio of the column to the prediction."""

    lag_s: float
    """Lag with the highest correlation [s]."""

    at_once: float
    """Correlation at zero lag [-]."""


class Recognizer:
    """Identifies joints by comparing the columns of a log with each other.

    Parameters
    ----------
    columns
        Numeric columns by name, ``(n,)`` each, sampled at regular times.
    period
        Sample period [s].
    hint_of
        Function that returns the hint for a column name.
    """

    def __init__(
        self,
        columns: Mapping[str, NDArray[np.float64]],
        period: float,
        hint_of: Callable[[str], Hint],
    ) -> None:
        varying = {
            name: _without_gaps(values) for name, values in columns.items() if _varies(values)
        }
        self.names = list(varying)
        self._hints = [hint_of(name) for name in self.names]
        stride = max(1, int(_STEP_S / period)) if period > 0.0 else 1
        values = np.array([_thinned(column, stride) for column in varying.values()])
        if values.size:
            values = values[:, _liveliest(values)]
            # A column that varies elsewhere may be constant in the rows that are compared.
            varies = np.ptp(values, axis=1) > 0.0
            values = values[varies]
            self.names = [name for name, kept in zip(self.names, varies, strict=True) if kept]
            self._hints = [hint for hint, kept in zip(self._hints, varies, strict=True) if kept]
        self.period = period * stride
        self.values = values

    @property
    def can_judge(self) -> bool:
        """Whether there are enough columns and rows to compare."""
        return len(self.names) > 1 and self.values.shape[1] >= _LEAST_ROWS

    def joints(self) -> list[JointColumns]:
        """Return the identified joints in order of decreasing certainty."""
        if not self.can_judge:
            return []
        scores = np.array([self._position_score(a) for a in range(len(self.names))])
        joints, used = [], set[int]()
        for a in np.argsort(-scores, kind="stable"):
            if scores[a] < _LEAST_SCORE or int(a) in used:
                continue
            joint = self._joint_of(int(a), used)
            joints.append(joint)
            used |= {self.names.index(item.name) for item in joint.columns.values()}
            # Copies of this position do not form further joints.
            used |= {b for b in range(len(self.names)) if self._is_copy(int(a), b)}
        return joints

    def copies(self, name: str) -> list[str]:
        """Return the columns that are proportional to the named column."""
        a = self.names.index(name)
        return [column for b, column in enumerate(self.names) if self._is_copy(a, b)]

    def _joint_of(self, a: int, taken: set[int]) -> JointColumns:
        rates = self._rates_of(a, taken)
        columns = {"position": IdentifiedColumn(self.names[a], bool(rates))}
        if rates:
            best = max(rates, key=lambda b: self._rate_score(a, b))
            columns["speed"] = IdentifiedColumn(self.names[best], self._is_sure_rate(a, best))
        used = {a, *(self.names.index(item.name) for item in columns.values())}
        command = self._command_of(a, taken | used)
        if command is not None:
            columns["command"] = command
            used.add(self.names.index(command.name))
        effort = self._effort_of(a, taken | used)
        if effort is not None:
            columns["effort"] = effort
        # An effort that the motion explains, or a command that it follows, confirms the position.
        if self._hints[a].supports("position") > 0.0 and any(
            item.is_confirmed for item in (command, effort) if item
        ):
            columns["position"] = IdentifiedColumn(self.names[a], is_confirmed=True)
        return JointColumns(columns)

    def _rates_of(self, a: int, used: set[int]) -> list[int]:
        return [
            b
            for b in range(len(self.names))
            if b != a and b not in used and self._rate_score(a, b) >= 1.0
        ]

    def _rate_score(self, a: int, b: int) -> float:
        """Return a score for column ``b`` as the speed of position ``a``; accepted from 1."""
        relation = self._rate[a][b]
        if abs(relation.correlation) < _RATE:
            return 0.0
        hint = self._hints[b]
        return (
            relation.at_once**2
            + 0.3 * _is_near(relation, _RATE_RATIOS)
            + 0.4 * hint.supports("speed")
            - 0.2 * hint.is_commanded
        )

    def _is_sure_rate(self, a: int, b: int) -> bool:
        relation = self._rate[a][b]
        return abs(relation.correlation) > _SURE_RATE and _is_near(relation, _RATE_RATIOS)

    def _position_score(self, a: int) -> float:
        """Return a score for a column as the measured position of a joint."""
        candidates = [b for b in range(len(self.names)) if b != a]
        hint = self._hints[a]
        rate = max((self._rate_score(a, b) for b in candidates), default=0.0)
        is_rate = max(
            (
                self._rate[b][a].correlation ** 2
                for b in candidates
                if self._is_sure_rate(b, a) and not self._hints[b].supports("effort") > 0.0
            ),
            default=0.0,
        )
        follows = max((self._copy[b][a].correlation for b in candidates), default=0.0)
        if rate < 1.0:
            # Without a speed, a column is a position if it explains an effort, especially if it
            # also follows a command.
            efforts = [b for b in candidates if not self._is_copy(a, b)]
            explained = max((self._explained_effort(a, b) for b in efforts), default=0.0)
            rate = max(explained if follows > _FOLLOWS else 0.5 * explained, 0.0)
        return (
            rate
            + 0.6 * hint.supports("position")
            - 0.4 * hint.is_commanded
            + 0.3 * (follows > _FOLLOWS)
            - 1.2 * is_rate
        )

    def _is_copy(self, a: int, b: int) -> bool:
        relation = self._copy[a][b]
        return a != b and abs(relation.correlation) > _SAME

    def _command_of(self, a: int, used: set[int]) -> IdentifiedColumn | None:
        """Return the command that a position follows, or None."""
        candidates: dict[int, tuple[float, bool]] = {}
        for b in range(len(self.names)):
            if b in used:
                continue
            hint, relation = self._hints[b], self._copy[b][a]
            leads = relation.lag_s > 0.5 * self.period
            is_followed = relation.correlation > _FOLLOWS and _is_near(relation, _COPY_RATIOS)
            if hint.supports("position") < 0.0 and not (is_followed and leads):
                continue
            if not hint.is_commanded and not (is_followed and leads):
                continue
            candidates[b] = (
                relation.correlation
                + hint.is_commanded
                + 0.3 * is_followed
                + 0.4 * hint.supports("position"),
                is_followed and leads and hint.is_commanded,
            )
        if not candidates:
            return None
        best = max(candidates, key=lambda b: candidates[b][0])
        return IdentifiedColumn(self.names[best], candidates[best][1])

    def _effort_of(self, a: int, used: set[int]) -> IdentifiedColumn | None:
        """Return the column best explained by inertia, friction and gravity, or None."""
        candidates: dict[int, tuple[float, bool]] = {}
        for b in range(len(self.names)):
            hint = self._hints[b]
            if b in used or self._is_copy(a, b) or hint.supports("effort") < 0.0:
                continue
            explained = self._explained_effort(a, b)
            if explained < _EXPLAINED and not hint.supports("effort") > 0.0:
                continue
            score = explained + 0.5 * hint.supports("effort") - 0.3 * hint.is_commanded
            candidates[b] = (score, explained >= _EXPLAINED and hint.supports("effort") > 0.0)
        if not candidates:
            return None
        best, *rest = sorted(candidates, key=lambda b: -candidates[b][0])
        is_alone = all(candidates[best][0] - candidates[b][0] > _ALIKE for b in rest)
        return IdentifiedColumn(self.names[best], candidates[best][1] and is_alone)

    def _explained_effort(self, a: int, b: int) -> float:
        """Return the cross-validated share of ``b`` that the motion of ``a`` explains [-]."""
        terms, effort = self._motion_terms(a), self._smooth[b]
        block = np.arange(len(effort)) * _BLOCKS // len(effort) % 2 == 0
        explained = []
        for fitted in (block, ~block):
            weights, *_ = np.linalg.lstsq(terms[fitted], effort[fitted], rcond=None)
            residual = effort[~fitted] - terms[~fitted] @ weights
            explained.append(1.0 - float(np.var(residual) / max(np.var(effort[~fitted]), 1e-300)))
        return min(explained)

    def _motion_terms(self, a: int) -> NDArray[np.float64]:
        """Return acceleration, friction and gravity regressors of a position, ``(n, 6)``."""
        position = (self._smooth[a] - np.mean(self._smooth[a])) / np.std(self._smooth[a])
        speed = np.gradient(position, self.period)
        acceleration = np.gradient(speed, self.period)
        direction = np.tanh(speed / (_FRICTION_SPEED * np.max(np.abs(speed))))
        constant = np.ones_like(position)
        return np.column_stack([acceleration, direction, speed, position, position**2, constant])

    @cached_property
    def _weights(self) -> NDArray[np.float64]:
        """Squared frequency response of a Gaussian low-pass filter."""
        width = max(_SMOOTH_S, _SMOOTH_SAMPLES * self.period)
        return np.asarray(np.exp(-((self._omega * width) ** 2)), dtype=np.float64)

    @cached_property
    def _omega(self) -> NDArray[np.float64]:
        frequencies = np.fft.rfftfreq(self.values.shape[1], self.period)
        return np.asarray(2.0 * np.pi * frequencies, dtype=np.float64)

    @cached_property
    def _spectra(self) -> NDArray[np.complex128]:
        """Spectra of the columns after subtracting the line between their end points."""
        return np.fft.rfft(self.values - self._lines, axis=1)

    @cached_property
    def _smooth(self) -> NDArray[np.float64]:
        n = self.values.shape[1]
        return self._lines + np.fft.irfft(self._spectra * np.sqrt(self._weights), n, axis=1)

    @cached_property
    def _lines(self) -> NDArray[np.float64]:
        """Straight lines between the end points of the columns, ``(columns, n)``."""
        ends = self.values[:, 0], self.values[:, -1]
        return np.linspace(*ends, self.values.shape[1], axis=1)

    @cached_property
    def _rate(self) -> list[list[_Relation]]:
        """Relation of each column (second index) to the derivative of each column (first index)."""
        slopes = self._spectra * (1j * self._omega)
        # The mean rate, excluded here, is the slope between the end points of the position. A speed
        # keeps the line between its end points: where a log ends in motion, it is not 0.
        return self._relations(slopes, np.fft.rfft(self.values, axis=1))

    @cached_property
    def _copy(self) -> list[list[_Relation]]:
        """Relation of each column (second index) to each column (first index)."""
        slopes = self._spectra * (1j * self._omega)
        return self._relations(slopes, slopes)

    def _relations(
        self, causes: NDArray[np.complex128], effects: NDArray[np.complex128]
    ) -> list[list[_Relation]]:
        n, weights = self.values.shape[1], self._weights.copy()
        weights[0] = 0.0
        energy = [np.sum(weights * np.abs(causes) ** 2, axis=1) for causes in (causes, effects)]
        # Period of the motion, from the energies of the columns and of their slopes.
        of_motion = np.sum(weights * np.abs(self._spectra) ** 2, axis=1)
        of_slope = np.sum(weights * np.abs(self._spectra * self._omega) ** 2, axis=1)
        periods = 2.0 * np.pi * np.sqrt(of_motion / np.maximum(of_slope, 1e-300))
        table = []
        for a, cause in enumerate(causes):
            products = np.fft.irfft(weights * np.conj(cause) * effects, n, axis=1) * (n / 2.0)
            most = round(min(_LAG_S, _LAG_SHARE * periods[a]) / self.period)
            lags = np.arange(-most, most + 1)
            row = []
            for b in range(len(effects)):
                near = products[b, lags]
                scale = np.sqrt(energy[0][a] * energy[1][b])
                best = int(np.argmax(np.abs(near)))
                if scale <= 0.0:
                    row.append(_Relation(0.0, 0.0, 0.0, 0.0))
                    continue
                row.append(
                    _Relation(
                        float(near[best] / scale),
                        float(near[best] / energy[0][a]),
                        float(lags[best] * self.period),
                        float(near[most] / scale),
                    )
                )
            table.append(row)
        return table


def _is_near(relation: _Relation, ratios: NDArray[np.float64]) -> bool:
    """Return whether the ratio matches one of `ratios`, allowing for bias from noise."""
    least, most = relation.ratio, relation.ratio / max(relation.correlation**2, 1e-9)
    low, high = ratios * (1.0 - _UNIT_TOLERANCE), ratios * (1.0 + _UNIT_TOLERANCE)
    return bool(np.any((most >= low) & (least <= high)))


def _varies(values: NDArray[np.float64]) -> bool:
    finite = values[np.isfinite(values)]
    return 2 * len(finite) > len(values) and len(np.unique(finite[:10_000])) >= _LEAST_DISTINCT


def _without_gaps(values: NDArray[np.float64]) -> NDArray[np.float64]:
    is_finite = np.isfinite(values)
    if np.all(is_finite):
        return values.astype(float)
    at = np.arange(len(values))
    return np.interp(at, at[is_finite], values[is_finite])


def _thinned(values: NDArray[np.float64], stride: int) -> NDArray[np.float64]:
    count = len(values) // stride
    return np.asarray(values[: count * stride].reshape(count, stride).mean(axis=1))


def _liveliest(values: NDArray[np.float64]) -> slice:
    """Return the window of ``_MOST_ROWS`` rows in which the columns change most."""
    n = values.shape[1]
    if n <= _MOST_ROWS:
        return slice(0, n)
    changes = np.abs(np.diff(values, axis=1)) / np.std(values, axis=1, keepdims=True)
    total = np.concatenate([[0.0], np.cumsum(np.sum(changes, axis=0))])
    start = int(np.argmax(total[_MOST_ROWS:] - total[: n - _MOST_ROWS]))
    return slice(start, start + _MOST_ROWS)
