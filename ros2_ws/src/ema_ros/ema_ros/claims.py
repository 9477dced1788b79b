"""Validity of published healths: a level holds for a limited time, and while its node reports."""

import copy
import math
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

from ema_core.levels import LEVEL_NAMES, OK, STALE
from ema_ros.stamps import stamp_from_message

SILENT_S: Final = 5.0
"""A node publishes its status each second; after so long without, it is silent [s]."""

Place = tuple[str, str]
"""Full topic and actuator."""


class Received(NamedTuple):
    """A health that was received.

    Attributes
    ----------
    health
        ``ema_interfaces/msg/Health`` or ``HealthSummary``.
    ends_s
        When its claim ends at the latest, by a clock that never goes back [s].
    """

    health: Any
    ends_s: float

    @classmethod
    def at(cls, health: Any, now_ns: int, now_s: float) -> "Received":
        """Return a health received at a time of the clock of stamps [ns] and a steady one [s]."""
        until_ns = stamp_from_message(health.good_until)
        if not until_ns:
            return cls(health, math.inf)
        begin_ns = 0
        if hasattr(health, "measured"):
            begin_ns = stamp_from_message(health.received) or stamp_from_message(health.measured)
        left_ns = until_ns - max(now_ns, begin_ns)
        return cls(health, now_s + left_ns * 1e-9)

    def ended_s(self, now_ns: int, now_s: float, *, is_real: bool = True) -> float:
        """Return how long ago its claim ended [s]; not positive while it holds.

        In simulated time, which is not real, the clock of stamps alone counts.
        """
        until_ns = stamp_from_message(self.health.good_until)
        ago_s = (now_ns - until_ns) * 1e-9 if until_ns else -math.inf
        return max(ago_s, now_s - self.ends_s) if is_real else ago_s


def worth(health: Any, ended_s: float, *, is_silent: bool = False) -> Any:
    """Return a health as it holds: STALE, with the level before, once its claim has ended.

    ``ema_interfaces/msg/Health`` or ``HealthSummary`` is not changed; ``ended_s`` is how long ago
    its claim ended [s], and its author may be silent.
    """
    if health.level == STALE or not (is_silent or ended_s > 0.0):
        return health
    # Changing parts are copied; the rest is shared.
    held = copy.copy(health)
    held.level, held.last_level = STALE, health.level
    why = f"{health.author or 'its monitor'} is silent"
    if not is_silent:
        why = f"it was good until {ended_s:.0f} s ago, and no later test has come"
    reason = f"{why}, the level was {LEVEL_NAMES[health.level]}"
    if not hasattr(health, "faults"):
        held.text = f"{LEVEL_NAMES[STALE]}; {reason}"
        return held
    held.confidence, held.reason = 0.0, reason
    held.faults, held.requirements = (
        [_without_ok(item) for item in items] for items in (health.faults, health.requirements)
    )
    return held


def _without_ok(item: Any) -> Any:
    if item.level == OK:
        item = copy.copy(item)
        item.level = STALE
    return item


class Claims:
    """The latest healths, and their replacements once their claims have ended.

    Times ``now_s`` are of a clock that never goes back.
    """

    def __init__(self) -> None:
        self._healths: dict[Place, Received] = {}
        self._shown: dict[Place, int] = {}
        self._heard_s: dict[str, float] = {}

    def note(self, key: Place, health: Any, now_ns: int, now_s: float) -> None:
        """Take a health as it is shown."""
        self._healths[key] = Received.at(health, now_ns, now_s)
        self._shown[key] = health.level

    def hear(self, node: str, now_s: float) -> None:
        """Note that a node, by its full name, has published its status."""
        self._heard_s[node] = now_s

    def rewind(self, time_ns: int) -> None:
        """Discard healths later than a time to which the clock has gone back [ns]."""
        for key, one in list(self._healths.items()):
            if stamp_from_message(one.health.header.stamp) > time_ns:
                del self._healths[key], self._shown[key]

    def changes(
        self, now_ns: int, now_s: float, *, is_live: bool = True, is_real: bool = True
    ) -> Iterator[tuple[Place, Any]]:
        """Yield the healths whose level differs from the shown level, as they are to be shown.

        A playback is not live: its monitors need not report. In simulated time, which is not real,
        claims end by the clock of stamps alone.
        """
        for key, one in list(self._healths.items()):
            health = one.health
            heard_s = self._heard_s.get(health.author)
            # A monitor that has never reported is not silent.
            is_silent = is_live and heard_s is not None and now_s - heard_s > SILENT_S
            ended_s = one.ended_s(now_ns, now_s, is_real=is_real)
            held = worth(health, ended_s, is_silent=is_silent)
            if held.level != self._shown.get(key):
                self._shown[key] = held.level
                yield key, held
