"""When a replay is diagnosed to its end."""

from collections.abc import Mapping
from typing import Final

_COUNTS: Final = ("blocks", "windows", "estimates valid", "estimates invalid")


class Completion:
    """Whether a player has ended, and the monitor has identified what it played.

    Reports come once a second and on change: two of the same counts in a row after the end, with an
    estimate for each window, say that nothing is on its way.

    Attributes
    ----------
    is_complete
        Whether that is so.
    """

    def __init__(self) -> None:
        self.is_complete = False
        self._has_ended = False
        self._last: dict[str, tuple[str, ...]] = {}

    def end(self) -> None:
        """Record that the player has ended."""
        if not self._has_ended:
            self._has_ended = True
            self._last.clear()

    def add_report(self, telemetry: Mapping[str, Mapping[str, str]]) -> None:
        """Add a report of the monitor.

        Parameters
        ----------
        telemetry
            Values of the status of each actuator's telemetry, by its name.
        """
        counts = {
            name: tuple(values.get(key, "") for key in _COUNTS)
            for name, values in telemetry.items()
        }
        if not self._has_ended or not counts:
            return
        is_still = counts == self._last
        self._last = counts
        self.is_complete |= is_still and all(
            int(windows) == int(valid) + int(invalid)
            for _, windows, valid, invalid in counts.values()
        )
