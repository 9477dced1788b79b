"""When a replay is diagnosed to its end."""

from collections.abc import Mapping
from typing import Final

_COUNTS: Final = ("blocks", "windows", "estimates valid", "estimates invalid")


class Completion:
    """Whether a player has ended, and the monitor has identified what it played.

    Reports come once a second and on change, of one monitor or of several that share the actuators:
    two of the same counts in a row after the end, with an estimate for each window, say of each
    actuator that nothing is on its way.

    Attributes
    ----------
    is_complete
        Whether that is so.
    """

    def __init__(self) -> None:
        self.is_complete = False
        self._has_ended = False
        self._last: dict[str, tuple[str, ...]] = {}
        # Actuators that were reported, and those of them of which nothing is on its way.
        self._known: set[str] = set()
        self._settled: set[str] = set()

    def end(self) -> None:
        """Record that the player has ended."""
        if not self._has_ended:
            self._has_ended = True
            self._last.clear()

    def add_report(self, telemetry: Mapping[str, Mapping[str, str]]) -> None:
        """Add a report of a monitor."""
        self._known.update(telemetry)
        if not self._has_ended or not telemetry:
            return
        for name, values in telemetry.items():
            counts = tuple(values.get(key, "") for key in _COUNTS)
            is_still, self._last[name] = counts == self._last.get(name), counts
            _, windows, valid, invalid = counts
            if is_still and int(windows) == int(valid) + int(invalid):
                self._settled.add(name)
            else:
                self._settled.discard(name)
        self.is_complete |= self._settled >= self._known
