"""Until when stretches of ordinary motion are combined, and what became of them."""

from dataclasses import dataclass
from typing import NamedTuple, Self

from ema_core.quantity import check_quantities, quantity
from ema_core.wording import counted
from ema_monitor.windows.trigger import Refusal


@dataclass(frozen=True)
class CombinationSettings:
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

    def __post_init__(self) -> None:
        check_quantities(self)


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
        Those that had to wait for too long.
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

    def plus_refusal(self, refused: Refusal) -> Self:
        """Return the tally with a stretch that is no window."""
        return self.plus(refused.reason, **{"dropped" if refused.is_dropped else "refused": 1})

    def __str__(self) -> str:
        words = (
            f"{counted(self.stretches, 'stretch')} of motion: {self.combined} combined, "
            f"{self.skipped} added nothing, {self.refused} refused"
        )
        words += f", {self.dropped} dropped" if self.dropped else ""
        return f"{words} (the latest: {self.reason})" if self.reason else words
