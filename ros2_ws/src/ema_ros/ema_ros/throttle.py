# SPDX-License-Identifier: Apache-2.0
"""Rate limit for repeated log lines."""

import re
from typing import Final

_NUMBERS: Final = re.compile(r"\d[\d.]*(e[+-]?\d+)?")
_MOST_KINDS: Final = 1000


class Throttle:
    """Passes a line at most once per period [s]; lines that differ only in numbers are equal."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        # Time of the last line of each kind, and number of suppressed lines since then.
        self._logged: dict[str, tuple[float, int]] = {}

    def passed(self, line: str, now_s: float) -> str | None:
        """Return the line to log, with the count of suppressed lines; None to suppress it."""
        kind = _NUMBERS.sub("#", line)
        before = self._logged.pop(kind, None)
        if before is not None and now_s - before[0] < self._period_s:
            self._logged[kind] = (before[0], before[1] + 1)
            return None
        if len(self._logged) >= _MOST_KINDS:
            del self._logged[next(iter(self._logged))]
        self._logged[kind] = (now_s, 0)
        suppressed = before[1] if before else 0
        return f"{line} (and {suppressed} similar before)" if suppressed else line
