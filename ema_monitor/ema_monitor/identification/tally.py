"""Until when stretches of ordinary motion are combined, and what became of them."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple, Self

from ema_core.quantity import Checked, quantity
from ema_core.wording import counted
from ema_monitor.identification.estimate import Estimate
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

_REFUSED_IN_A_ROW: Final = 3


@dataclass(frozen=True)
class CombinationSettings(Checked):
    """Until when stretches of ordinary motion are combined to one estimate.

    Raises
    ------
    ValueError
        When a figure is outside its range; the message names it.
    """

    wanted_sigma: float = quantity(
        0.01, "-", 1e-4, 0.25, "standard deviation of each fault at which motion gives an estimate"
    )
    most_stretches: int = quantity(
        60, "-", 1, 10_000, "largest number of stretches of motion looked at for an estimate"
    )
    longest_s: float = quantity(
        600.0, "s", 0.01, 1e7, "longest time from the first to the last stretch of an estimate"
    )
    pause_s: float = quantity(
        10.0, "s", 0.0, 1e7, "time after an estimate in which motion is not looked at"
    )


class Tally(NamedTuple):
    """How many stretches there were, and what became of them.

    Attributes
    ----------
    stretches
        All of them.
    combined
        Those that an estimate rests on, or the next one will.
    skipped
        Those that would not have told anything new, or that followed an estimate too soon.
    refused
        Those that nothing explains, or that cannot be used.
    dropped
        Those that the monitor dropped because its queue was full.
    fruitless
        Combinations that have shown no fault as well as wanted.
    reason
        Why the latest one was refused or dropped; empty when an estimate has been made since.
    """

    stretches: int = 0
    combined: int = 0
    skipped: int = 0
    refused: int = 0
    dropped: int = 0
    fruitless: int = 0
    reason: str = ""

    def plus(self, because: str | None = None, **more: int) -> Self:
        """Return the tally with higher counts, and another reason if there is one."""
        counts = {name: getattr(self, name) + number for name, number in more.items()}
        return self._replace(reason=self.reason if because is None else because, **counts)

    def __str__(self) -> str:
        words = (
            f"{counted(self.stretches, 'stretch')} of motion: {self.combined} combined, "
            f"{self.skipped} added nothing, {self.refused} refused"
        )
        words += f", {self.dropped} dropped" if self.dropped else ""
        return f"{words} (the latest: {self.reason})" if self.reason else words


class Combining(ABC):
    """Combines stretches of one actuator's motion, whatever is known of its drive.

    Attributes
    ----------
    tally
        How many stretches there were.
    """

    def __init__(self, settings: CombinationSettings) -> None:
        self.tally = Tally()
        self._settings = settings
        self._refused_in_a_row = 0
        self._pause_ns = (0, 0)

    def add(self, stretch: Window | Refusal) -> Iterator[Any]:
        """Yield the state after each generation of a search, and the estimates it completes.

        Where it is not gone on with, what was combined before the stretch is left as it is.
        """
        self.tally = self.tally.plus(stretches=1)
        if isinstance(stretch, Refusal):
            counted_as = "dropped" if stretch.is_dropped else "refused"
            self.tally = self.tally.plus(stretch.reason, **{counted_as: 1})
        else:
            yield from self._take(stretch)

    @abstractmethod
    def _take(self, stretch: Window) -> Iterator[Any]: ...

    @abstractmethod
    def finish(self) -> list[Estimate]:
        """End the motion; return the estimate of what was combined so far, if there is one."""

    def _reaches_limit(self, stretch: Window, number: int, first_ns: int, last_ns: int) -> bool:
        """Return whether a number of stretches, the first and last begun then [ns], is complete.

        So it is where the clock has gone back: an estimate ends after it has started.
        """
        age_s = (stretch.end_ns - first_ns) * 1e-9
        is_full = number >= self._settings.most_stretches or age_s > self._settings.longest_s
        return is_full or stretch.start_ns < last_ns

    def _is_paused(self, stretch: Window) -> bool:
        # A clock that has gone back must not lengthen the pause.
        begin_ns, end_ns = self._pause_ns
        return begin_ns <= stretch.start_ns < end_ns

    def _count_refused(self, refused: Estimate, *, is_known: bool = False) -> list[Estimate]:
        """Count a stretch that is refused; several in a row without any estimate are said once."""
        self.tally = self.tally.plus(refused.reason, refused=1)
        # One that has an estimate may be more than the model can follow: the status counts these.
        self._refused_in_a_row += not is_known
        is_said = self._refused_in_a_row == _REFUSED_IN_A_ROW and not is_known
        return [replace(refused, stretches=1)] if is_said else []

    def _concluded(self, found: Estimate | None, reason: str | None = None) -> list[Estimate]:
        """Count an estimate of what was combined, or that there is none, and return it."""
        if found is None:
            self.tally = self.tally.plus(reason, fruitless=1)
            return []
        self._pause_ns = found.end_ns, found.end_ns + round(self._settings.pause_s * 1e9)
        self.tally = self.tally._replace(reason="")
        return [found]
