# SPDX-License-Identifier: Apache-2.0
"""End of the healthy records of a recording: a time, a duration or a number of records."""

import math
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final, Self

_DURATION: Final = re.compile(r"(\d+(?:\.\d+)?)\s*(s|min|h|d)")
_SECONDS: Final = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86_400.0}


@dataclass(frozen=True)
class HealthyUntil:
    """End of the healthy records. A record is healthy if it meets all three conditions."""

    time_ns: float = math.inf
    """Time before which records are healthy [ns]."""
    duration_s: float = math.inf
    """Time from the first sample within which records are healthy [s]."""
    records: float = math.inf
    """Number of healthy records at the beginning."""

    @classmethod
    def of(cls, text: str) -> Self:
        """Parse a date or time in ISO 8601, a duration such as ``2 h``, or a number of records.

        A time without offset is UTC.

        Raises
        ------
        ValueError
            If the text is not a time, a duration or a number of records.
        """
        text = text.strip()
        if text.isdecimal() and len(text) <= 6 and int(text):
            return cls(records=int(text))
        if match := _DURATION.fullmatch(text):
            return cls(duration_s=float(match[1]) * _SECONDS[match[2]])
        try:
            time = datetime.fromisoformat(text)
        except ValueError:
            raise ValueError(
                f"{text!r}: expected a number of records such as 10, a duration such as 2h or 3d, "
                "or a time such as 2026-11-03 or 2026-11-03T14:00"
            ) from None
        time = time if time.tzinfo else time.replace(tzinfo=UTC)
        return cls(time_ns=time.timestamp() * 1e9)

    def includes(self, end_ns: int, first_ns: int, number: int) -> bool:
        """Return whether a record is healthy.

        Parameters
        ----------
        end_ns
            Timestamp of the record's last sample [ns].
        first_ns
            Timestamp of the first sample of all records [ns].
        number
            Number of the record, from 0.
        """
        return (
            end_ns < self.time_ns
            and 1e-9 * (end_ns - first_ns) <= self.duration_s
            and number < self.records
        )
