# SPDX-License-Identifier: Apache-2.0
"""Conversion of timestamps in nanoseconds to and from builtin_interfaces/Time."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from builtin_interfaces.msg import Time

_NS_PER_S = 1_000_000_000


def check_stamp(stamp_ns: int) -> None:
    """Raise ``ValueError`` if a time [ns] does not fit a message (about ±68 years)."""
    if not -(2**31) <= int(stamp_ns) // _NS_PER_S < 2**31:
        raise ValueError(f"stamp_ns = {stamp_ns} ns is outside [-2^31, 2^31) s")


def stamp_to_message(stamp_ns: int) -> "Time":
    """Convert a time [ns] to a message. Raises ``ValueError`` outside about ±68 years."""
    from builtin_interfaces.msg import Time  # reading needs no ROS

    check_stamp(stamp_ns)
    sec, nanosec = divmod(int(stamp_ns), _NS_PER_S)
    return Time(sec=sec, nanosec=nanosec)


def stamp_from_message(message: "Time") -> int:
    """Return the time of a message since the epoch [ns]."""
    return message.sec * _NS_PER_S + message.nanosec
