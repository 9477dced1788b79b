"""Recognition of position, speed, effort and command of joints in the columns of a log, by physics.

A speed is the derivative of a position. The position follows a command. An effort is the sum of
inertia, friction and gravity in a motion. Names support the physics, and decide if it cannot.
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
# Time constant of the filter [s], and its smallest value in samples.
_SMOOTH_S: Final = 0.03
_SMOOTH_SAMPLES: Final = 2.0
# Lags up to which columns are compared [s], and in shares of the period of the motion.
_LAG_S: Final = 0.5
_LAG_SHARE: Final = 1.0 / 8.0
_RATE: Final = 0.8
_SURE_RATE: Final = 0.95
_FOLLOWS: Final = 0.9
_EXPLAINED: Final = 0.3
_ALIKE: Final = 0.1
_SAME: Final = 0.985
_UNIT_TOLERANCE: Final = 0.04
_BLOCKS: Final = 10
_FRICTION_SPEED: Final = 0.02


class Hint(NamedTuple):
    """Hint at the quantity of a column from its name."""

    quantities: frozenset[str]
    """Quantities that fit the name; empty if the name is no hint."""

    is_commanded: bool = False
    """Whether the name denotes a commanded value."""

    def supports(self, quantity: str) -> float:
        """Return the support of the name for a quantity, from -1 to 1 [-]."""
        if not self.quantities:
            return 0.0
        return 1.0 if quantity in self.quantities else -1.0


class Finding(NamedTuple):
    """A column for a quantity."""

    name: str
    """Name of the column."""

    is_confirmed: bool
    """Whether physics supports the choice, not only the name."""


@dataclass(frozen=True)
class JointColumns:
    """Columns of one joint."""

    columns: Mapping[str, Finding]
    """Columns by quantity: position, command, speed, effort."""

    travel: float
    """Range of the position, in its unit."""


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
"""Ratios of a speed to the derivative of a position, in the usual pairs of units."""
_COPY_RATIOS: Final = np.array([1.0, ANGLES["rad"] / ANGLES["deg"], ANGLES["deg"], 1e3, 1e-3])
"""Ratios of a position to its command, in the usual pairs of units."""


class _Relation(NamedTuple):
    """Relation of a column to its prediction by a second column."""

    correlation: float
    """Correlation at the best lag [-]."""

    ratio: float
    """Ratio of the column to its prediction."""

    lag_s: float
    """Best lag [s]."""

    at_once: float
    """Correlation without a lag [-]."""


class Recognizer:
    """Compares the columns of a log with each other.

    Parameters
    ----------
    columns
        Columns of numbers by name, ``(n,)`` each, at regular times.
    period
        Their sample period [s].
    hint_of
        Returns the hint of a name.
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
        self.period = period * stride
        self.values = values
        self._position: dict[int, float] = {}

    @property
    def can_judge(self) -> bool:
        """Whether there are enough columns and rows to compare."""
        return len(self.names) > 1 and self.values.shape[1] >= _LEAST_ROWS

    def joints(self) -> list[JointColumns]:
        """Return the joints, by decreasing certainty."""
        if not self.can_judge:
            return []
        scores = np.array([self._position_score(a) for a in range(len(self.names))])
        joints, taken = [], set[int]()
        for a in np.argsort(-scores, kind="stable"):
            if scores[a] < 0.8 or int(a) in taken:
                continue
            joint = self._joint_of(int(a), taken)
            joints.append(joint)
            taken |= {self.names.index(item.name) for item in joint.columns.values()}
            # Copies of this position are not further joints.
            taken |= {
                b for b in range(len(self.names)) if self._is_copy(int(a), b) and b not in taken
            }
        return joints

    def _joint_of(self, a: int, taken: set[int]) -> JointColumns:
        rates = self._rates_of(a, taken)
        columns = {"position": Finding(self.names[a], bool(rates))}
        if rates:
            best = max(rates, key=lambda b: self._rate_score(a, b))
            columns["speed"] = Finding(self.names[best], self._is_sure_rate(a, best))
        used = {a, *(self.names.index(item.name) for item in columns.values())}
        command = self._command_of(a, taken | used)
        if command is not None:
            columns["command"] = command
            used.add(self.names.index(command.name))
        effort = self._effort_of(a, taken | used)
        if effort is not None:
            columns["effort"] = effort
        # An explained effort, or a followed command, confirms the name of a position.
        if self._hints[a].supports("position") > 0.0 and any(
            item.is_confirmed for item in (command, effort) if item
        ):
            columns["position"] = Finding(self.names[a], is_confirmed=True)
        return JointColumns(columns, float(np.ptp(self.values[a])))

    def _rates_of(self, a: int, taken: set[int]) -> list[int]:
        return [
            b
            for b in range(len(self.names))
            if b != a and b not in taken and self._rate_score(a, b) >= 1.0
        ]

    def _rate_score(self, a: int, b: int) -> float:
        """Return a score for a column as the speed of a position; at least 1 if it is."""
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
        rest = [b for b in range(len(self.names)) if b != a]
        hint = self._hints[a]
        rate = max((self._rate_score(a, b) for b in rest), default=0.0)
        is_rate = max(
            (
                self._rate[b][a].correlation ** 2
                for b in rest
                if self._is_sure_rate(b, a) and not self._hints[b].supports("effort") > 0.0
            ),
            default=0.0,
        )
        follows = max((self._copy[b][a].correlation for b in rest), default=0.0)
        if rate < 1.0:
            # Without a speed, a column is a position if it explains an effort, in particular if
            # it follows a second column as a position follows its command.
            efforts = [b for b in rest if not self._is_copy(a, b)]
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

    def _command_of(self, a: int, taken: set[int]) -> Finding | None:
        """Return the command that a position follows."""
        able: dict[int, tuple[float, bool]] = {}
        for b in range(len(self.names)):
            if b in taken:
                continue
            hint, relation = self._hints[b], self._copy[b][a]
            leads = relation.lag_s > 0.5 * self.period
            is_followed = relation.correlation > _FOLLOWS and _is_near(relation, _COPY_RATIOS)
            if hint.supports("position") < 0.0 and not (is_followed and leads):
                continue
            if not hint.is_commanded and not (is_followed and leads):
                continue
            able[b] = (
                relation.correlation
                + hint.is_commanded
                + 0.3 * is_followed
                + 0.4 * hint.supports("position"),
                is_followed and leads and hint.is_commanded,
            )
        if not able:
            return None
        best = max(able, key=lambda b: able[b][0])
        return Finding(self.names[best], able[best][1])

    def _effort_of(self, a: int, taken: set[int]) -> Finding | None:
        """Return the column that inertia, friction and gravity of a joint explain best."""
        able: dict[int, tuple[float, bool]] = {}
        for b in range(len(self.names)):
            hint = self._hints[b]
            if b in taken or self._is_copy(a, b) or hint.supports("effort") < 0.0:
                continue
            explained = self._explained_effort(a, b)
            if explained < _EXPLAINED and not hint.supports("effort") > 0.0:
                continue
            score = explained + 0.5 * hint.supports("effort") - 0.3 * hint.is_commanded
            able[b] = (score, explained >= _EXPLAINED and hint.supports("effort") > 0.0)
        if not able:
            return None
        best, *rest = sorted(able, key=lambda b: -able[b][0])
        is_alone = all(able[best][0] - able[b][0] > _ALIKE for b in rest)
        return Finding(self.names[best], able[best][1] and is_alone)

    def _explained_effort(self, a: int, b: int) -> float:
        """Return the share of a column explained by the motion of a position, cross-validated."""
        terms, effort = self._motion_terms(a), self._smooth[b]
        block = np.arange(len(effort)) * _BLOCKS // len(effort) % 2 == 0
        explained = []
        for fitted in (block, ~block):
            weights, *_ = np.linalg.lstsq(terms[fitted], effort[fitted], rcond=None)
            rest = effort[~fitted] - terms[~fitted] @ weights
            explained.append(1.0 - float(np.var(rest) / max(np.var(effort[~fitted]), 1e-300)))
        return min(explained)

    def _motion_terms(self, a: int) -> NDArray[np.float64]:
        """Return the terms of acceleration, friction and gravity of a position, ``(n, 6)``."""
        position = (self._smooth[a] - np.mean(self._smooth[a])) / np.std(self._smooth[a])
        speed = np.gradient(position, self.period)
        acceleration = np.gradient(speed, self.period)
        direction = np.tanh(speed / (_FRICTION_SPEED * np.max(np.abs(speed))))
        constant = np.ones_like(position)
        return np.column_stack([acceleration, direction, speed, position, position**2, constant])

    @cached_property
    def _weights(self) -> NDArray[np.float64]:
        """Square of a Gaussian low-pass filter by frequency."""
        width = max(_SMOOTH_S, _SMOOTH_SAMPLES * self.period)
        return np.asarray(np.exp(-((self._omega * width) ** 2)), dtype=np.float64)

    @cached_property
    def _omega(self) -> NDArray[np.float64]:
        frequencies = np.fft.rfftfreq(self.values.shape[1], self.period)
        return np.asarray(2.0 * np.pi * frequencies, dtype=np.float64)

    @cached_property
    def _spectra(self) -> NDArray[np.complex128]:
        """Spectra of the columns minus the lines between their ends."""
        n = self.values.shape[1]
        lines = np.linspace(self.values[:, 0], self.values[:, -1], n, axis=1)
        return np.fft.rfft(self.values - lines, axis=1)

    @cached_property
    def _smooth(self) -> NDArray[np.float64]:
        n = self.values.shape[1]
        lines = np.linspace(self.values[:, 0], self.values[:, -1], n, axis=1)
        return lines + np.fft.irfft(self._spectra * np.sqrt(self._weights), n, axis=1)

    @cached_property
    def _rate(self) -> list[list[_Relation]]:
        """Relations of each column (second index) to the derivative of each column (first)."""
        slopes = self._spectra * (1j * self._omega)
        # The mean of a rate is the slope of the line between the ends of a position.
        return self._relations(slopes, self._spectra)

    @cached_property
    def _copy(self) -> list[list[_Relation]]:
        """Relations of each column (second index) to each column (first)."""
        slopes = self._spectra * (1j * self._omega)
        return self._relations(slopes, slopes)

    def _relations(
        self, causes: NDArray[np.complex128], effects: NDArray[np.complex128]
    ) -> list[list[_Relation]]:
        n, weights = self.values.shape[1], self._weights.copy()
        weights[0] = 0.0
        energy = [np.sum(weights * np.abs(causes) ** 2, axis=1) for causes in (causes, effects)]
        # Angular frequency of the motion, from the energies of slope and column.
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
    """Return whether a ratio is in a list, within the bias by the noise of either column."""
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
    """Return the ``_MOST_ROWS`` rows in which the columns change most."""
    n = values.shape[1]
    if n <= _MOST_ROWS:
        return slice(0, n)
    changes = np.abs(np.diff(values, axis=1)) / np.std(values, axis=1, keepdims=True)
    total = np.concatenate([[0.0], np.cumsum(np.sum(changes, axis=0))])
    start = int(np.argmax(total[_MOST_ROWS:] - total[: n - _MOST_ROWS]))
    return slice(start, start + _MOST_ROWS)
