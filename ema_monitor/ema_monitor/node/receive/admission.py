# SPDX-License-Identifier: Apache-2.0
"""Admission of actuators to a monitor by list, shard and limit, with refusal counts."""

import hashlib
from collections import Counter
from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any, Final

from ema_core.description import check_name
from ema_core.levels import OK, WARN
from ema_core.quantity import Checked, quantity, texts
from ema_core.wording import counted
from ema_monitor.node.settings import Operation
from ema_ros.node_parameters import LiveSettings

_MOST_NAMED: Final = 3
_MOST_MEASURED: Final = 1000
_MEASURED_S: Final = 60.0


class _Ignored(Enum):
    """Why a message is ignored."""

    UNNAMED = auto()
    """It has no ``actuator_id``."""
    UNKNOWN = auto()
    """It is malformed, and its actuator is not monitored."""
    OTHER_SHARD = auto()
    """Its actuator belongs to another shard."""
    NOT_LISTED = auto()
    """Its actuator is not listed."""
    BEYOND_LIMIT = auto()
    """Its actuator exceeds the limit ``most_actuators``."""


_TEXTS: Final = {
    _Ignored.UNNAMED: "messages without actuator_id",
    _Ignored.UNKNOWN: "malformed messages of actuators that are not monitored",
    _Ignored.OTHER_SHARD: "messages of other shards",
    _Ignored.NOT_LISTED: "messages of unlisted actuators",
    _Ignored.BEYOND_LIMIT: "messages of actuators beyond the limit",
}


def shard_of(actuator_id: str, count: int, listed: Collection[str] = ()) -> int:
    """Return the index of an actuator's shard among ``count``; stable across releases.

    It is the 8-byte BLAKE2b digest of the UTF-8 name, as a big-endian number, modulo ``count``.
    Listed actuators are instead assigned round-robin in the order of these numbers, so that shard
    sizes differ by at most one.
    """
    if actuator_id in listed:
        return sorted(listed, key=lambda name: (_number_of(name), name)).index(actuator_id) % count
    return _number_of(actuator_id) % count


def _number_of(actuator_id: str) -> int:
    name = actuator_id.encode("utf-8", "surrogatepass")
    return int.from_bytes(hashlib.blake2b(name, digest_size=8).digest(), "big")


@dataclass(frozen=True)
class Shard(Checked):
    """The actuators of one monitor, if they are divided among several monitors."""

    index: int = quantity(0, "-", 0, 255, "number of the shard that this monitor follows, from 0")
    count: int = quantity(
        1, "-", 1, 256, "number of monitors among which the actuators are divided"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.index >= self.count:
            raise ValueError(
                f"index = {self.index}: expected 0 to {self.count - 1}, because the actuators are "
                f"divided among count = {self.count} monitors"
            )

    def has(self, actuator_id: str, listed: Collection[str] = ()) -> bool:
        """Return whether an actuator belongs to this shard (see ``shard_of``)."""
        return self.count == 1 or shard_of(actuator_id, self.count, listed) == self.index

    def __str__(self) -> str:
        return f"shard {self.index} of {self.count}"


@dataclass(frozen=True)
class Selection(Checked):
    """The list of actuators to monitor."""

    actuators: tuple[str, ...] = texts(
        "actuator_id of each actuator to monitor; empty: every actuator that publishes"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for number, name in enumerate(self.actuators):
            check_name(f"actuators[{number}]", name)
        repeated = [
            name for name in dict.fromkeys(self.actuators) if self.actuators.count(name) > 1
        ]
        if repeated:
            raise ValueError(f"actuators = {list(self.actuators)}: {repeated[0]!r} is repeated")

    def of(self, shard: Shard) -> tuple[str, ...]:
        """Return the listed actuators of a shard."""
        return tuple(name for name in self.actuators if shard.has(name, self.actuators))


class Admission:
    """Decides which actuators are monitored. The memory of refused actuators is bounded.

    An actuator is accepted if it belongs to this shard and to the list (if any), up to
    ``most_actuators`` actuators.

    Attributes
    ----------
    listed
        Listed actuators of this shard.
    """

    def __init__(
        self, selection: Selection, shard: Shard, operation: LiveSettings[Operation]
    ) -> None:
        self.listed = selection.of(shard)
        self._all_listed = selection.actuators
        self._shard = shard
        self._operation = operation
        self._counts: Counter[_Ignored] = Counter()
        # The latest malformed and refused messages of unmonitored actuators, by kind.
        self._latest: dict[_Ignored, str] = {}
        # Steady times of the latest measured causes by actuator, monitored or not [s].
        self._measured: dict[str, float] = {}

    def check(self) -> None:
        """Raise ValueError if the list is longer than ``most_actuators``."""
        limit = self._operation.value.most_actuators
        if len(self.listed) > limit:
            raise ValueError(
                f"actuators lists {len(self.listed)} of {self._shard}: expected at most "
                f"most_actuators = {limit}"
            )

    def describe_list(self) -> str:
        """Return a log line with the listed actuators by shard; empty without a list."""
        if not self._all_listed:
            return ""
        other_shards = [name for name in self._all_listed if name not in self.listed]
        text = f"listed actuators of {self._shard}: {', '.join(self.listed) or 'none'}"
        return f"{text}; of other shards: {', '.join(other_shards)}" if other_shards else text

    def why_not(self, actuator_id: str) -> str:
        """Return why this monitor ignores an actuator; empty if the actuator may be monitored."""
        kind = self._kind(actuator_id)
        if kind is _Ignored.OTHER_SHARD:
            shard = shard_of(actuator_id, self._shard.count, self._all_listed)
            return f"it belongs to shard {shard}, this monitor has {self._shard}"
        return "" if kind is None else "it is not listed in the parameter actuators"

    def ignores(self, actuator_id: str) -> bool:
        """Return whether the messages of an actuator are ignored; count the message if so."""
        kind = self._kind(actuator_id)
        if kind is not None:
            self._counts[kind] += 1
        return kind is not None

    def _kind(self, actuator_id: str) -> _Ignored | None:
        """Return why messages of an actuator are ignored; None if they are accepted."""
        if actuator_id in self._all_listed:
            return None if actuator_id in self.listed else _Ignored.OTHER_SHARD
        if self._all_listed:
            return _Ignored.NOT_LISTED
        return None if self._shard.has(actuator_id) else _Ignored.OTHER_SHARD

    def refuse(self, actuator_id: str, followed: Collection[str]) -> str | None:
        """Return why one more actuator is refused; None if it may be monitored.

        The reason is empty after the first refusal.
        """
        limit = self._operation.value.most_actuators
        if len(followed) < limit:
            return None
        self._count(_Ignored.BEYOND_LIMIT, repr(actuator_id))
        is_first = self._counts[_Ignored.BEYOND_LIMIT] == 1
        return f"not monitored: the limit most_actuators = {limit} is reached" if is_first else ""

    def note_wrong(self, actuator_id: str, reason: str) -> bool:
        """Count a malformed message of an unmonitored actuator. Return whether it is the first.

        Messages with and without ``actuator_id`` are counted separately.
        """
        kind = _Ignored.UNKNOWN if actuator_id else _Ignored.UNNAMED
        self._count(kind, f"{actuator_id!r}: {reason}")
        return self._counts[kind] == 1

    def note_measured(self, actuator_id: str, now_s: float) -> None:
        """Note that measured causes of an actuator were received at a steady time [s].

        Only the status of its shard names the actuator.
        """
        if self._kind(actuator_id) is _Ignored.OTHER_SHARD:
            return
        with suppress(ValueError):
            check_name("actuator_id", actuator_id)
            self._measured.pop(actuator_id, None)
            self._measured[actuator_id] = now_s
        if len(self._measured) > _MOST_MEASURED:
            self.forget_measured(next(iter(self._measured)))

    def forget_measured(self, actuator_id: str) -> None:
        """Forget the measured causes of an actuator."""
        self._measured.pop(actuator_id, None)

    def status(
        self, followed: Collection[str], now_s: float = 0.0, *, is_receiving: bool = True
    ) -> tuple[int, str]:
        """Return status level and message of the reception from all actuators.

        The message names actuators that are not monitored, although measured causes of them were
        received in the last 60 s.

        Parameters
        ----------
        followed
            The monitored actuators.
        now_s
            Current steady time [s].
        is_receiving
            Whether any actuator sends telemetry.
        """
        remarks = []
        if not followed and not self._counts[_Ignored.OTHER_SHARD]:
            remarks.append("no message from an actuator so far")
        remarks += [
            f"ignored: {self._counts[kind]} {_TEXTS[kind]}, the latest of {self._latest[kind]}"
            for kind in (_Ignored.UNNAMED, _Ignored.UNKNOWN, _Ignored.BEYOND_LIMIT)
            if self._counts[kind]
        ]
        if unused := [
            repr(name)
            for name, time_s in self._measured.items()
            if name not in followed and now_s - time_s <= _MEASURED_S
        ]:
            more = f" and {len(unused) - _MOST_NAMED} more" if len(unused) > _MOST_NAMED else ""
            are = "are" if len(unused) > 1 else "is"
            names = ", ".join(unused[:_MOST_NAMED])
            remarks.append(f"measured causes of {names}{more}, which {are} not monitored")
        if remarks:
            return WARN, "; ".join(remarks)
        monitored = f"{counted(len(followed), 'actuator')} monitored"
        if followed and not is_receiving:
            return WARN, f"{monitored}; no telemetry is received"
        return OK, monitored

    def figures(self, followed: Collection[str]) -> dict[str, Any]:
        """Return the key-value pairs of the admission status."""
        return {
            "shard": f"{self._shard.index} of {self._shard.count}",
            "actuators": len(followed),
            "most actuators": self._operation.value.most_actuators,
            **{
                _TEXTS[kind]: self._counts[kind]
                for kind in (_Ignored.BEYOND_LIMIT, _Ignored.NOT_LISTED, _Ignored.OTHER_SHARD)
            },
        }

    def _count(self, kind: _Ignored, latest: str) -> None:
        self._counts[kind] += 1
        self._latest[kind] = latest
