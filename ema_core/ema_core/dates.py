"""Distinction between dated timestamps and times since a clock started."""

from typing import Final

FIRST_DATE_NS: Final = 10 * 365 * 86_400_000_000_000
"""Smallest timestamp that counts as a date [ns]: no clock runs for 10 years without a restart."""


def has_date(stamp_ns: int) -> bool:
    """Return whether a timestamp [ns] is a date counted from 1970."""
    return stamp_ns >= FIRST_DATE_NS
