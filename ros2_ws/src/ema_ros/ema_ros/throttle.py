"""Log lines that would repeat, let through now and then."""

import re
from typing import Final

_NUMBERS: Final = re.compile(r"\d[\d.]*(e[+-]?\d+)?")
_MOST_KINDS: Final = 1000


class Throttle:
    """Passes a line at most once in a period [s]; lines that differ in numbers count as equal."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        # When each kind of line was let through last, and how many were held back since.
        self._said: dict[str, tuple[float, int]] = {}

    def passed(self, line: str, now_s: float) -> str | None:
        """Return the line if it is to be logged now [s], with how many were held back, or None."""
        kind = _NUMBERS.sub("#", line)
        before = self._said.pop(kind, None)
        if before is not None and now_s - before[0] < self._period_s:
            self._said[kind] = (before[0], before[1] + 1)
            return None
        if len(self._said) >= _MOST_KINDS:
            del self._said[next(iter(self._said))]
        self._said[kind] = (now_s, 0)
        held_back = before[1] if before else 0
        return f"{line} (and {held_back} like it before)" if held_back else line
