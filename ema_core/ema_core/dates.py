"""Distinction of dated time stamps from times since the start of a clock."""

from typing import Final

FIRST_DATE_NS: Final = 10 * 365 * 86_400_000_000_000
"""Smallest time stamp that is a date [ns]: no clock runs for 10 years after its start."""


def has_date(stamp_ns: int) -> bool:
    """Return whether a time stamp [ns] is a date, counted from 1970."""
    return stamp_ns >= FIRST_DATE_NS
