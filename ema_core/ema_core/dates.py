# SPDX-License-Identifier: Apache-2.0
"""Distinction between dates and clock readings in timestamps, and formatting of both."""

from datetime import UTC, datetime, timedelta
from typing import Final

FIRST_DATE_NS: Final = 10 * 365 * 86_400_000_000_000
"""Smallest timestamp that counts as a date [ns]: no clock runs for 10 years without a restart."""


def has_date(stamp_ns: int) -> bool:
    """Return whether a timestamp [ns] is a date, counted from 1970, and not a time since boot."""
    return stamp_ns >= FIRST_DATE_NS


def moment(stamp_ns: int) -> str:
    """Return a timestamp [ns] as a string: date and time in UTC, or elapsed time without a date."""
    if stamp_ns < 86_400 * 10**9:
        return f"{stamp_ns * 1e-9:,.2f} s"
    if not has_date(stamp_ns):
        return str(timedelta(seconds=stamp_ns // 10**9))
    return f"{datetime.fromtimestamp(stamp_ns * 1e-9, UTC):%Y-%m-%d %H:%M:%S} UTC"


def utc_minute(time_ns: int) -> str:
    """Return a time since 1970 [ns] as a string: date and time in UTC, to the minute."""
    return f"{datetime.fromtimestamp(time_ns // 1_000_000_000, UTC):%Y-%m-%d %H:%M} UTC"
