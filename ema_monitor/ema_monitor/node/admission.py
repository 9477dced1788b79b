"""Which messages a monitor takes, and what becomes of the others: counted, and bounded."""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from typing import Any, Final

from ema_core.levels import OK, WARN
from ema_core.wording import counted
from ema_monitor.node.selection import Selection, Shard, shard_of
from ema_monitor.node.settings import Operation
from ema_ros.settings import LiveSettings

_MOST_REMEMBERED: Final = 100
_UNNAMED: Final = "messages without actuator_id"
_UNKNOWN: Final = "wrong messages of actuators that are not monitored"
_OTHER_SHARDS: Final = "messages of other shards"
_NOT_LISTED: Final = "messages of actuators not listed"
_REFUSED: Final = "messages of actuators beyond the limit"


class Admission:
    """Decides which actuators are followed; what it keeps of the others is bounded.

    An actuator is followed if it is of this shard and listed, where there is a list, as long as
    there are not ``most_actuators`` of them. Beyond these it takes the place of the one that is
    silent longest, if that is not listed and its silence lasts, or is refused.

    Parameters
    ----------
    selection, shard
        What is to be followed.
    operation
        How many actuators are followed at most, and how long one is silent before it gives way.

    Attributes
    ----------
    listed
        Those of the list that are of this shard.
    """

    def __init__(
        self,
        selection: Selection,
        shard: Shard,
        operation: LiveSettings[Operation],
    ) -> None:
        self.listed = selection.of(shard)
        self._all_listed = selection.actuators
        self._shard = shard
        self._operation = operation
        self._counts: Counter[str] = Counter()
        # Of wrong messages of nobody, and of refused ones, the latest.
        self._latest: dict[str, str] = {}
        self._forgotten = 0

    @property
    def _most_actuators(self) -> int:
        return self._operation.value.most_actuators

    def clear(self) -> None:
        """Forget what was received."""
        self._counts.clear()
        self._latest.clear()
        self._forgotten = 0

    def check(self) -> None:
        """Raise ValueError when more are listed than may be followed."""
        most = self._most_actuators
        if len(self.listed) > most:
            raise ValueError(
                f"actuators lists {len(self.listed)} of {self._shard}: expected at most "
                f"most_actuators = {most}"
            )

    def list_in_words(self) -> str:
        """Return which of the listed actuators are followed; empty without a list."""
        if not self._all_listed:
            return ""
        others = [name for name in self._all_listed if name not in self.listed]
        words = f"listed actuators of {self._shard}: {', '.join(self.listed) or 'none'}"
        return f"{words}; of other shards: {', '.join(others)}" if others else words

    def why_not(self, actuator_id: str) -> str:
        """Return why an actuator is not to be followed by this monitor; empty when it is."""
        kind = self._kind(actuator_id)
        if kind == _OTHER_SHARDS:
            shard = shard_of(actuator_id, self._shard.count, self._all_listed)
            return f"it is of shard {shard}, and this monitor has {self._shard}"
        return "it is not listed in the parameter actuators" if kind == _NOT_LISTED else ""

    def ignores(self, actuator_id: str) -> bool:
        """Return whether a message is for others, and count it if so."""
        kind = self._kind(actuator_id)
        if kind:
            self._counts[kind] += 1
        return bool(kind)

    def _kind(self, actuator_id: str) -> str:
        """Return what messages of an actuator are counted as; empty where it is to be followed."""
        if self._all_listed:
            if actuator_id in self.listed:
                return ""
            return _OTHER_SHARDS if actuator_id in self._all_listed else _NOT_LISTED
        return "" if self._shard.has(actuator_id) else _OTHER_SHARDS

    def has_room(self, followed: Collection[str]) -> bool:
        """Return whether one more can be followed."""
        return len(followed) < self._most_actuators

    def refuse(self, actuator_id: str) -> str:
        """Refuse an actuator for which there is no room; return why, if it is the first one."""
        self._count(_REFUSED, repr(actuator_id))
        if self._counts[_REFUSED] > 1:
            return ""
        return f"not followed, as most_actuators = {self._most_actuators} are"

    def silent_for_long(self, silent_s: Mapping[str, float]) -> str:
        """Return which actuator gives way to another one; empty when none does.

        Parameters
        ----------
        silent_s
            For how long each followed one is silent [s].
        """
        after_s = self._operation.value.forget_after_s
        silent = {
            name: silence_s
            for name, silence_s in silent_s.items()
            if silence_s > after_s and name not in self.listed
        }
        self._forgotten += bool(silent)
        return max(silent, key=silent.__getitem__) if silent else ""

    def note_wrong(self, actuator_id: str, reason: str) -> bool:
        """Record a wrong message of nobody that is followed; return whether it is the first."""
        kind = _UNKNOWN if actuator_id else _UNNAMED
        self._count(kind, f"{actuator_id!r}: {reason}")
        return self._counts[kind] == 1

    def status(self, followed: Iterable[str]) -> tuple[int, str]:
        """Return level and message on what is received of all."""
        number = len(list(followed))
        remarks = []
        if not number and not self._counts[_OTHER_SHARDS]:
            remarks.append("no message of an actuator so far")
        remarks += [
            f"ignored: {self._counts[kind]} {kind}, the latest of {self._latest[kind]}"
            for kind in (_UNNAMED, _UNKNOWN, _REFUSED)
            if self._counts[kind]
        ]
        if remarks:
            return WARN, "; ".join(remarks)
        return OK, f"{counted(number, 'actuator')} monitored"

    def figures(self, followed: Collection[str]) -> dict[str, Any]:
        """Return the figures of the status."""
        return {
            "shard": f"{self._shard.index} of {self._shard.count}",
            "actuators": len(followed),
            "most actuators": self._most_actuators,
            "actuators forgotten": self._forgotten,
            **{kind: self._counts[kind] for kind in (_REFUSED, _NOT_LISTED, _OTHER_SHARDS)},
        }

    def _count(self, kind: str, latest: str) -> None:
        self._counts[kind] += 1
        self._latest[kind] = latest
