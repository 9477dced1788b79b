# SPDX-License-Identifier: Apache-2.0
"""Validity of published health: levels expire, and their monitor must be alive."""

import copy
import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from ema_core.levels import LEVEL_NAMES, OK, STALE
from ema_ros.stamps import stamp_from_message

Place = tuple[str, str]
"""Full topic name and actuator id."""


class Received(NamedTuple):
    """A received health message and its validity."""

    health: Any
    """``ema_interfaces/msg/Health`` or ``HealthSummary``."""
    ends_s: float
    """Latest end of its validity, on a monotonic clock [s]."""

    @classmethod
    def at(cls, health: Any, now_ns: int, now_s: float) -> "Received":
        """Return a health received at ROS time ``now_ns`` and monotonic time ``now_s``."""
        until_ns = stamp_from_message(health.good_until)
        if not until_ns:
            return cls(health, math.inf)
        begin_ns = 0
        if hasattr(health, "tested"):
            begin_ns = stamp_from_message(health.received) or stamp_from_message(health.tested)
        left_ns = until_ns - max(now_ns, begin_ns)
        return cls(health, now_s + left_ns * 1e-9)

    def ended_s(self, now_ns: int, now_s: float, *, is_real: bool = True) -> float:
        """Return the time since the validity ended [s]; not positive while valid.

        In simulated time (``is_real`` is False) only the ROS clock counts.
        """
        until_ns = stamp_from_message(self.health.good_until)
        ago_s = (now_ns - until_ns) * 1e-9 if until_ns else -math.inf
        return max(ago_s, now_s - self.ends_s) if is_real else ago_s


def worth(health: Any, ended_s: float, *, is_silent: bool = False) -> Any:
    """Return a health, with its level changed to STALE if it has expired or its monitor is silent.

    The previous level is then in ``last_level``.

    Parameters
    ----------
    health
        ``ema_interfaces/msg/Health`` or ``HealthSummary``; it is not changed.
    ended_s
        Time since its validity ended [s].
    is_silent
        Whether its monitor is silent.
    """
    if health.level == STALE or not (is_silent or ended_s > 0.0):
        return health
    # Only changed parts are copied.
    expired = copy.copy(health)
    expired.level, expired.last_level = STALE, health.level
    cause = f"{health.author or 'its monitor'} is silent"
    if not is_silent:
        cause = f"the latest test expired {ended_s:.0f} s ago"
    reason = f"{cause}, the level was {LEVEL_NAMES[health.level]}"
    if not hasattr(health, "faults"):
        expired.text = f"{LEVEL_NAMES[STALE]}; {reason}"
        return expired
    expired.confidence, expired.reason = 0.0, reason
    expired.faults, expired.requirements = (
        [_without_ok(item) for item in items] for items in (health.faults, health.requirements)
    )
    return expired


def _without_ok(item: Any) -> Any:
    if item.level == OK:
        item = copy.copy(item)
        item.level = STALE
    return item


class Claims:
    """Latest published health by topic and actuator, replaced by STALE on expiry.

    Times ``now_s`` are monotonic.
    """

    def __init__(self) -> None:
        self._healths: dict[Place, Received] = {}
        self._shown: dict[Place, int] = {}

    def note(self, key: Place, health: Any, now_ns: int, now_s: float) -> None:
        """Store a published health."""
        self._healths[key] = Received.at(health, now_ns, now_s)
        self._shown[key] = health.level

    def rewind(self, time_ns: int) -> None:
        """Discard health later than ``time_ns``, to which the clock has jumped back."""
        for key, received in list(self._healths.items()):
            if stamp_from_message(received.health.header.stamp) > time_ns:
                del self._healths[key], self._shown[key]

    def changes(
        self,
        now_ns: int,
        now_s: float,
        is_silent: Callable[[str, str], bool],
        *,
        is_real: bool = True,
    ) -> Iterator[tuple[Place, Any]]:
        """Yield each health whose level differs from the level shown.

        Parameters
        ----------
        now_ns
            ROS time [ns].
        now_s
            Monotonic time [s].
        is_silent
            Function that returns whether a monitor is silent, given full topic name and author.
        is_real
            Whether time is real; in simulated time, health expires by the ROS clock only.
        """
        for key, received in list(self._healths.items()):
            health = received.health
            ended_s = received.ended_s(now_ns, now_s, is_real=is_real)
            current = worth(health, ended_s, is_silent=is_silent(key[0], health.author))
            if current.level != self._shown.get(key):
                self._shown[key] = current.level
                yield key, current
