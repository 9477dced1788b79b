# SPDX-License-Identifier: Apache-2.0
"""Settings and counts of the combination of stretches of ordinary motion."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple, Self

from ema_core.quantity import Checked, quantity
from ema_core.wording import counted
from ema_monitor.identification.estimate import Estimate
from ema_monitor.reason_texts import joined
from ema_monitor.reasons import Reason
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

_REFUSED_IN_A_ROW: Final = 3


@dataclass(frozen=True)
class CombinationSettings(Checked):
    """Settings for combining stretches of ordinary motion into one estimate.

    Raises
    ------
    ValueError
        If a value is outside its range; the message names it.
    """

    wanted_sigma: float = quantity(
        0.01, "-", 1e-4, 0.25, "standard deviation of each fault at which motion gives an estimate"
    )
    most_stretches: int = quantity(
        60, "-", 1, 10_000, "largest number of stretches of motion examined for an estimate"
    )
    longest_s: float = quantity(
        600.0, "s", 0.01, 1e7, "longest time from the first to the last stretch of an estimate"
    )
    pause_s: float = quantity(
        10.0, "s", 0.0, 1e7, "time after an estimate in which motion is not examined"
    )


class Tally(NamedTuple):
    """Numbers of stretches of motion by their use."""

    stretches: int = 0
    """All stretches."""
    combined: int = 0
    """Stretches that are part of an estimate, or of the combination in progress."""
    skipped: int = 0
    """Stretches that would add no information, or that followed too soon after an estimate."""
    refused: int = 0
    """Stretches that cannot be used, or that the model cannot explain."""
    dropped: int = 0
    """Stretches that the monitor dropped because its queue was full or it was not active."""
    fruitless: int = 0
    """Combinations in which no fault reached the target accuracy."""
    reasons: tuple[Reason, ...] = ()
    """Reasons for the latest refused or dropped stretch; empty after an estimate."""

    @property
    def reason(self) -> str:
        """The reasons as a sentence."""
        return joined(self.reasons)

    def plus(self, because: tuple[Reason, ...] | None = None, **more: int) -> Self:
        """Return the tally with counts increased by ``more``, and with a new reason if passed."""
        counts = {name: getattr(self, name) + number for name, number in more.items()}
        return self._replace(reasons=self.reasons if because is None else because, **counts)

    def __str__(self) -> str:
        words = (
            f"{counted(self.stretches, 'stretch')} of motion: {self.combined} combined, "
            f"{self.skipped} added nothing, {self.refused} refused"
        )
        words += f", {self.dropped} dropped" if self.dropped else ""
        return f"{words} (the latest: {self.reason})" if self.reason else words


class Combining(ABC):
    """Base class that combines the stretches of an actuator's motion, for any kind of drive.

    Attributes
    ----------
    tally
        Counts of the stretches.
    """

    def __init__(self, settings: CombinationSettings) -> None:
        self.tally = Tally()
        self._settings = settings
        self._refused_in_a_row = 0
        self._pause_ns = (0, 0)

    def add(self, stretch: Window | Refusal) -> Iterator[Any]:
        """Process a stretch: yield the state after each generation, and completed estimates.

        If the caller stops iterating, the stretches combined so far are unchanged.
        """
        self.tally = self.tally.plus(stretches=1)
        if isinstance(stretch, Refusal):
            counted_as = "dropped" if stretch.is_dropped else "refused"
            self.tally = self.tally.plus((stretch.cause,), **{counted_as: 1})
        else:
            yield from self._process(stretch)

    @abstractmethod
    def _process(self, stretch: Window) -> Iterator[Any]: ...

    @abstractmethod
    def finish(self) -> list[Estimate]:
        """End the combination. Return the estimate of the stretches combined so far, if any."""

    def _reaches_limit(self, stretch: Window, number: int, first_ns: int, last_ns: int) -> bool:
        """Return whether a combination is complete before a stretch is added.

        ``number`` is the number of stretches so far; ``first_ns`` and ``last_ns`` are the starts of
        the first and last stretch [ns]. A combination is also complete if the clock jumps back.
        """
        age_s = (stretch.end_ns - first_ns) * 1e-9
        is_full = number >= self._settings.most_stretches or age_s > self._settings.longest_s
        return is_full or stretch.start_ns < last_ns

    def _is_paused(self, stretch: Window) -> bool:
        # A clock that jumps back must not lengthen the pause.
        begin_ns, end_ns = self._pause_ns
        return begin_ns <= stretch.start_ns < end_ns

    def _count_refused(self, refused: Estimate, *, is_identified: bool = False) -> list[Estimate]:
        """Count a refused stretch; return its estimate if it is the third in a row.

        If ``is_identified``, the search gave an estimate that was not accepted.
        """
        self.tally = self.tally.plus(refused.reasons, refused=1)
        # An identified stretch may have motion that the model cannot follow: it is only counted.
        self._refused_in_a_row += not is_identified
        is_reported = self._refused_in_a_row == _REFUSED_IN_A_ROW and not is_identified
        return [replace(refused, stretches=1)] if is_reported else []

    def _concluded(self, estimate: Estimate | None) -> list[Estimate]:
        """Count a finished combination; return its estimate, or an empty list without one."""
        if estimate is None:
            self.tally = self.tally.plus(fruitless=1)
            return []
        self._pause_ns = estimate.end_ns, estimate.end_ns + round(self._settings.pause_s * 1e9)
        self.tally = self.tally._replace(reasons=())
        return [estimate]
