# SPDX-License-Identifier: Apache-2.0
"""Memory of a unit's earlier tests: a prior for faults and slow hidden causes.

The method is described in ``docs/identification.md``, M27.
"""

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
# Degrees of freedom of the prior: its heavy tails limit the penalty of distant values.
_TAIL = 4.0
# Distance beyond which a window contradicts the memory [sigma].
_CONTRADICTED = 3.0


class Pace(NamedTuple):
    """Rate at which a hidden cause or fault changes."""

    in_month: float
    """Standard deviation of the change in a month, in the unit of the cause."""
    at_least: float
    """Standard deviation of the change between any two tests, in the unit of the cause."""

    def widened(self, variance: Array | float, months: float) -> Array | float:
        """Return a variance increased by the expected change over some months."""
        return variance + self.at_least**2 + months * self.in_month**2


SLOW: Final[Mapping[str, Pace]] = {
    "torque_constant": Pace(0.01, 0.01),
    "viscous_friction": Pace(0.2, 0.1),
    "inertia": Pace(0.01, 0.02),
    "current_gain": Pace(0.005, 0.005),
    "speed_gain": Pace(0.002, 0.001),
}
"""Rates of the hidden causes that are remembered. All other causes may change between tests."""

_FAULT = Pace(0.02, 0.02)
_MAY_GROW = np.array(
    [not fault.is_two_sided and i != ECCENTRICITY_PHASE for i, fault in enumerate(FAULTS)]
)


@dataclass(frozen=True, eq=False)
class Memory:
    """Results of a unit's earlier tests, as a prior for the faults and causes of its next test."""

    stamp_ns: int = 0
    """End of the latest test that the memory contains [ns]; 0 without tests."""
    causes: Mapping[str, CauseEstimate] = field(default_factory=dict)
    """Slow causes by name; the value is 0 if no test has shown the cause."""
    clear: frozenset[str] = frozenset()
    """Names of the causes that a test has distinguished from all alternatives."""
    faults: Array = field(default_factory=lambda: np.zeros(N_FAULTS))
    """Faults, ``(8,)``."""
    variances: Array = field(default_factory=lambda: np.full(N_FAULTS, np.inf))
    """Variances of the faults, ``(8,)``; infinite for an unknown fault."""

    def after(self, months: float) -> Self:
        """Return the memory with its uncertainty increased by the passage of some months."""
        causes = {
            name: cause._replace(sigma=float(np.sqrt(SLOW[name].widened(cause.sigma**2, months))))
            for name, cause in self.causes.items()
        }
        return replace(self, causes=causes, variances=_FAULT.widened(self.variances, months))

    def before(self, stamp_ns: int) -> "Memory":
        """Return the memory with its uncertainty at a time [ns].

        Before the end of the latest test, `NOTHING` is returned.
        """
        if not self.stamp_ns or stamp_ns < self.stamp_ns:
            return NOTHING
        return self.after((stamp_ns - self.stamp_ns) / _MONTH_NS)

    def updated(self, estimate: Estimate) -> "Memory":
        """Return the memory updated with the estimate of a test.

        The estimate must have been made with this memory. The memory is unchanged by an estimate
        that is not valid, comes from stretches, or ends before the latest test.
        """
        if not estimate.valid or estimate.stretches or estimate.end_ns < self.stamp_ns:
            return self
        before = self.before(estimate.end_ns)
        shown = {cause.name: cause for cause in estimate.causes if cause.name in SLOW}
        doubtful = names_of(estimate.alternatives)
        causes, clear = dict(before.causes), set(before.clear)
        for name, pace in SLOW.items():
            if name not in doubtful:
                causes[name] = shown.get(name, CauseEstimate(name, 0.0, pace.at_least))
                clear.add(name)
            elif name in shown and name not in clear:
                causes[name] = shown[name]
        is_doubtful = np.isin(FAULT_NAMES, list(doubtful))
        variances = np.square(estimate.sigma)
        variances[~_MAY_GROW | is_doubtful | ~np.isfinite(variances)] = np.inf
        faults = np.where(np.isfinite(variances), estimate.faults, 0.0)
        return Memory(estimate.end_ns, causes, frozenset(clear), faults, variances)

    @property
    def expected(self) -> tuple[CauseEstimate, ...]:
        """Hidden causes that a test has shown and distinguished from all alternatives.

        They are expected in the next test.
        """
        return tuple(
            self.causes[name] for name in SLOW if name in self.clear and self.causes[name].value
        )

    def informed(self, window: Window) -> Window:
        """Return a window with the expected causes as additional measured causes."""
        measured = {cause.name for cause in window.measured}
        more = tuple(cause for cause in self.expected if cause.name not in measured)
        return replace(window, measured=window.measured + more) if more else window

    def left_by(self, estimate: Estimate) -> "Memory":
        """Return the memory without the causes that an estimate contradicts.

        If the estimate is not valid, `NOTHING` is returned.
        """
        if not estimate.valid:
            return NOTHING
        values = {cause.name: cause.value for cause in estimate.causes}
        wrong = {
            cause.name
            for cause in self.expected
            if abs(values.get(cause.name, cause.value) - cause.value) > _CONTRADICTED * cause.sigma
        }
        if not wrong:
            return self
        causes = {name: cause for name, cause in self.causes.items() if name not in wrong}
        return replace(self, causes=causes, clear=self.clear - wrong)

    def surprise(self, faults: Array, causes: Mapping[str, Array]) -> Array:
        """Return -2 ln of the prior density of explanations, relative to its maximum, ``(n,)``.

        The causes in ``expected`` do not contribute, because `informed` adds them to the window.

        Parameters
        ----------
        faults
            Fault vectors, ``(n, 8)``. The growth of a fault does not reduce the density.
        causes
            Values of hidden causes by name, ``(n,)`` each.
        """
        squares = [np.maximum(self.faults - faults, 0.0) ** 2 / self.variances]
        expected = self.expected
        for name, cause in self.causes.items():
            if name in causes and cause not in expected:
                squares.append(((causes[name][:, None] - cause.value) / cause.sigma) ** 2)
        terms = np.concatenate(squares, axis=1)
        return (_TAIL + 1.0) * np.sum(np.log1p(terms / _TAIL), axis=1)


NOTHING: Final = Memory()
"""The memory of a unit without earlier tests."""
