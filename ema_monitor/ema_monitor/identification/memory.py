"""What a unit's earlier tests tell of the next one: a prior for slow hidden causes and faults."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple, Self

import numpy as np

from ema_core.arrays import Array
from ema_core.causes import CauseEstimate
from ema_core.faults import ECCENTRICITY_PHASE, FAULT_NAMES, FAULTS, N_FAULTS
from ema_monitor.identification.alternatives import names_of
from ema_monitor.identification.estimate import Estimate
from ema_monitor.windows.window import Window

_MONTH_NS: Final = 30 * 86_400 * 10**9
# Degrees of freedom of the prior: what is far from it costs little more than what is near.
_TAIL = 4.0
# Standard deviations from which on a window contradicts what is remembered.
_CONTRADICTED = 3.0


class Pace(NamedTuple):
    """Standard deviations of what changes in a month, and between any two tests, in its unit."""

    in_month: float
    at_least: float

    def widened(self, variance: Array | float, months: float) -> Array | float:
        """Return a variance after some months."""
        return variance + self.at_least**2 + months * self.in_month**2


SLOW: Final[Mapping[str, Pace]] = {
    "torque_constant": Pace(0.01, 0.01),
    "viscous_friction": Pace(0.2, 0.1),
    "inertia": Pace(0.01, 0.02),
    "current_gain": Pace(0.005, 0.005),
    "speed_gain": Pace(0.002, 0.001),
}
"""Hidden causes that have a memory; all others come and go."""

_FAULT = Pace(0.02, 0.02)
_MAY_GROW = np.array(
    [not one.is_two_sided and i != ECCENTRICITY_PHASE for i, one in enumerate(FAULTS)]
)


@dataclass(frozen=True, eq=False)
class Memory:
    """What is remembered of a unit (M27).

    Attributes
    ----------
    stamp_ns
        When the latest test that is part of it ended [ns].
    causes
        Slow causes, with value and standard deviation; 0 of those that tests have not shown.
    clear
        Names of those that a test has told from everything else.
    faults, variances
        Faults and their variances, ``(8,)``; an infinite variance of what is not known.
    """

    stamp_ns: int = 0
    causes: Mapping[str, CauseEstimate] = field(default_factory=dict)
    clear: frozenset[str] = frozenset()
    faults: Array = field(default_factory=lambda: np.zeros(N_FAULTS))
    variances: Array = field(default_factory=lambda: np.full(N_FAULTS, np.inf))

    def after(self, months: float) -> Self:
        """Return what is still known after some months."""
        causes = {
            name: one._replace(sigma=float(np.sqrt(SLOW[name].widened(one.sigma**2, months))))
            for name, one in self.causes.items()
        }
        return replace(self, causes=causes, variances=_FAULT.widened(self.variances, months))

    def before(self, stamp_ns: int) -> "Memory":
        """Return what is known at a time; nothing before the end of the latest test."""
        if not self.stamp_ns or stamp_ns < self.stamp_ns:
            return NOTHING
        return self.after((stamp_ns - self.stamp_ns) / _MONTH_NS)

    def updated(self, estimate: Estimate) -> "Memory":
        """Return what is known after a test, which was identified with this memory."""
        if not estimate.valid or estimate.stretches or estimate.end_ns < self.stamp_ns:
            return self
        known = self.before(estimate.end_ns)
        found = {one.name: one for one in estimate.causes if one.name in SLOW}
        doubtful = names_of(estimate.alternatives)
        causes, clear = dict(known.causes), set(known.clear)
        for name, pace in SLOW.items():
            if name not in doubtful:
                causes[name] = found.get(name, CauseEstimate(name, 0.0, pace.at_least))
                clear.add(name)
            elif name in found and name not in clear:
                causes[name] = found[name]
        is_doubtful = np.isin(FAULT_NAMES, list(doubtful))
        variances = np.square(estimate.sigma)
        variances[~_MAY_GROW | is_doubtful | ~np.isfinite(variances)] = np.inf
        faults = np.where(np.isfinite(variances), estimate.faults, 0.0)
        return Memory(estimate.end_ns, causes, frozenset(clear), faults, variances)

    @property
    def expected(self) -> tuple[CauseEstimate, ...]:
        """Causes that the next test has, too."""
        return tuple(
            self.causes[name] for name in SLOW if name in self.clear and self.causes[name].value
        )

    def informed(self, window: Window) -> Window:
        """Return a window with expected causes as if they were measured, but for those that are."""
        known = {one.name for one in window.measured}
        more = tuple(one for one in self.expected if one.name not in known)
        return replace(window, measured=window.measured + more) if more else window

    def left_by(self, estimate: Estimate) -> "Memory":
        """Return the memory without what an estimate contradicts; nothing if it is not valid."""
        if not estimate.valid:
            return NOTHING
        found = {one.name: one.value for one in estimate.causes}
        wrong = {
            one.name
            for one in self.expected
            if abs(found.get(one.name, one.value) - one.value) > _CONTRADICTED * one.sigma
        }
        if not wrong:
            return self
        causes = {name: one for name, one in self.causes.items() if name not in wrong}
        return replace(self, causes=causes, clear=self.clear - wrong)

    def surprise(self, faults: Array, causes: Mapping[str, Array]) -> Array:
        """Return -2 ln of the density of explanations, ``(n,)``, over the highest one.

        Parameters
        ----------
        faults
            Fault vectors, ``(n, 8)``: a fault may grow at no cost.
        causes
            Values of hidden causes by name, ``(n,)`` each.
        """
        squares = [np.maximum(self.faults - faults, 0.0) ** 2 / self.variances]
        expected = self.expected
        for name, one in self.causes.items():
            if name in causes and one not in expected:
                squares.append(((causes[name][:, None] - one.value) / one.sigma) ** 2)
        every = np.concatenate(squares, axis=1)
        return (_TAIL + 1.0) * np.sum(np.log1p(every / _TAIL), axis=1)


NOTHING: Final = Memory()
"""The memory of a unit without earlier tests."""
