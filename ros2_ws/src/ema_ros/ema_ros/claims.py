"""What healths are worth that nodes have published: a level is good for a time, and of one node."""

import copy
from collections.abc import Iterator
from typing import Any, Final

from ema_core.levels import LEVEL_NAMES, OK, STALE
from ema_ros.stamps import stamp_from_message

SILENT_S: Final = 5.0
"""A monitor reports on `/diagnostics` each second; after so long without, it is silent [s]."""

Place = tuple[str, str]
"""Full topic and actuator."""


def worth(health: Any, now_ns: int, *, is_silent: bool = False) -> Any:
    """Return a health as it holds at a time: STALE, with the level before, once its claim ended.

    ``ema_interfaces/msg/Health`` or ``HealthSummary`` is not changed; the time is of the clock of
    its stamps [ns], and its author may be silent.
    """
    until_ns = stamp_from_message(health.good_until)
    if health.level == STALE or not (is_silent or 0 < until_ns < now_ns):
        return health
    # The parts that change are copied, of the rest only who has them.
    held = copy.copy(health)
    held.level, held.last_level = STALE, health.level
    why = f"{health.author or 'its monitor'} is silent"
    if not is_silent:
        ago_s = (now_ns - until_ns) * 1e-9
        why = f"it was good until {ago_s:.0f} s ago, and no later test has come"
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
    """The latest healths, and what is to be shown in their place as their claims end.

    Times ``now_s`` are of a clock that never goes back.
    """

    def __init__(self) -> None:
        self._healths: dict[Place, Any] = {}
        self._shown: dict[Place, int] = {}
        self._heard_s: dict[str, float] = {}

    def note(self, key: Place, health: Any) -> None:
        """Take a health as it is shown."""
        self._healths[key], self._shown[key] = health, health.level

    def hear(self, status_name: str, now_s: float) -> None:
        """Take the name of a status of `/diagnostics`: its node is there."""
        self._heard_s[status_name.partition(": ")[0]] = now_s

    def rewind(self, time_ns: int) -> None:
        """Forget what is later than a time to which the clock has gone back [ns]."""
        for key, health in list(self._healths.items()):
            if stamp_from_message(health.header.stamp) > time_ns:
                del self._healths[key], self._shown[key]

    def changes(
        self, now_ns: int, now_s: float, *, is_live: bool = True
    ) -> Iterator[tuple[Place, Any]]:
        """Yield the healths that are worth another level than was shown, as they are to be shown.

        In a playback, which is not live, their authors are not to be heard.
        """
        for key, health in list(self._healths.items()):
            heard_s = self._heard_s.get(health.author)
            # Of one that was never heard nothing is missing.
            is_silent = is_live and heard_s is not None and now_s - heard_s > SILENT_S
            held = worth(health, now_ns, is_silent=is_silent)
            if held.level != self._shown.get(key):
                self._shown[key] = held.level
                yield key, held
