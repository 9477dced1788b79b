# SPDX-License-Identifier: Apache-2.0
"""Recording of received messages to a bag, or in memory until a snapshot is written."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message

from ema_bags.writer import BagWriter
from ema_core.levels import LEVEL_NAMES
from ema_core.quantity import Checked, flag, quantity, text, texts
from ema_core.wording import counted
from ema_interfaces.msg import FaultEstimate, Health, HealthSummary

_READ: Final = (FaultEstimate, Health, HealthSummary, DiagnosticArray)
_OVERHEAD_BYTES: Final = 200
_LEAST_BAG_BYTES: Final = 100_000
# Every flush also ends a chunk; smaller chunks would double the growth of the index in memory.
_CHUNK_BYTES: Final = 768 * 1024


@dataclass(frozen=True)
class RecorderSettings(Checked):
    """Settings of a recorder, fixed while a bag is open.

    Settings that exist in rosbag2 have the same names.
    """

    output: str = text(
        "",
        "bag to write: a single file if the name ends in .mcap, else a folder; empty: ema_<UTC "
        "date and time> in the working folder",
    )
    overwrite: bool = flag(False, "replace an existing bag")
    flush_s: float = quantity(
        0.5,
        "s",
        0.01,
        60.0,
        "longest time between writes; a killed recorder loses at most this time",
    )
    max_bag_size: int = quantity(
        0, "B", 0, 10**15, "size at which the next file begins, at least 100000; 0: never"
    )
    max_bag_duration: float = quantity(
        0.0, "s", 0.0, 1e7, "recorded time after which the next file begins; 0: never"
    )
    snapshot_duration: float = quantity(
        0.0,
        "s",
        0.0,
        86400.0,
        "time kept in memory and written when a level changes or ~/snapshot is called; 0: "
        "every message is written immediately",
    )
    snapshot_after: float = quantity(
        0.0, "s", 0.0, 3600.0, "time after a level change until the snapshot is written"
    )
    snapshot_levels: str = text(
        "all",
        "levels whose changes trigger a snapshot: all (health and diagnostics), or health",
        ("all", "health"),
    )
    max_snapshots_size: int = quantity(
        0, "B", 0, 10**15, "size of all snapshots, above which the oldest are deleted; 0: no limit"
    )
    max_cache_size: int = quantity(
        104857600,
        "B",
        100_000,
        10**12,
        "memory for a snapshot; if it is full, the oldest messages are dropped",
    )
    topics: tuple[str, ...] = texts(
        "topics to record; empty: the namespace, /diagnostics and /clock"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if 0 < self.max_bag_size < _LEAST_BAG_BYTES:
            raise ValueError(
                f"max_bag_size = {self.max_bag_size} B: expected 0 or at least {_LEAST_BAG_BYTES} B"
            )
        several = ("max_bag_size", "max_bag_duration", "snapshot_duration")
        chosen = [name for name in several if getattr(self, name)]
        for name in ("snapshot_after", "max_snapshots_size"):
            if getattr(self, name) and not self.snapshot_duration:
                raise ValueError(
                    f"{name} = {getattr(self, name):g}: expected snapshot_duration as well"
                )
        if chosen and self.output.endswith(".mcap"):
            raise ValueError(
                f"output = {self.output!r} is a single file: expected a folder (a name without "
                f".mcap), because {chosen[0]} = {getattr(self, chosen[0]):g} splits the bag"
            )


class _Kept(NamedTuple):
    """A serialised message with its times [ns]."""

    topic: str
    data: bytes
    log_time_ns: int
    publish_time_ns: int | None

    @property
    def size(self) -> int:
        """Approximate memory use [B]."""
        return len(self.data) + _OVERHEAD_BYTES


class BagRecorder:
    """An open bag that records received messages; one thread at a time may use it.

    Parameters
    ----------
    path
        Path of the bag.
    recorder_name
        Full name of the recorder node, whose statuses do not trigger a snapshot.
    on_failure
        Called if the thread that writes the bag has ended unexpectedly (see ``BagWriter``).

    Attributes
    ----------
    messages
        Number of messages received and written.
    snapshots
        Number of snapshots written.
    kept_bytes
        Memory of the messages kept for the next snapshot [B].
    is_short
        Whether messages within ``snapshot_duration`` were dropped for lack of memory.

    Raises
    ------
    ValueError, OSError
        As for ``BagWriter``.
    """

    def __init__(
        self,
        path: str,
        settings: RecorderSettings,
        recorder_name: str,
        on_failure: Callable[[str, str], object],
    ) -> None:
        self.bag = BagWriter(
            path,
            flush_s=settings.flush_s,
            chunk_bytes=_CHUNK_BYTES,
            max_bytes=settings.max_bag_size,
            max_duration_s=settings.max_bag_duration,
            overwrite=settings.overwrite,
            waits_for_room=True,
            on_failure=on_failure,
        )
        self.messages = self.snapshots = self.kept_bytes = 0
        self.is_short = False
        self._settings = settings
        self._kept: deque[_Kept] = deque()
        self._status_prefix = f"{recorder_name}:"
        self._levels: dict[str, int] = {}
        # Level changes that await a snapshot, and the log time at which it is due, and at which it
        # is due at the latest [ns].
        self._changes: list[str] = []
        self._due_ns = self._latest_due_ns = 0

    @property
    def kept_s(self) -> float:
        """Time from the first to the last kept message [s]."""
        kept = self._kept
        return max(0.0, (kept[-1].log_time_ns - kept[0].log_time_ns) / 1e9) if kept else 0.0

    def receive(
        self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int | None
    ) -> str:
        """Record or keep a message; return the reason for a snapshot, or "" if none is due."""
        message = self._read(topic, data)
        if isinstance(message, FaultEstimate) and message.calibration_id:
            name = f"calibration_id of {message.actuator_id}"
            self.bag.custom_data[name] = message.calibration_id
        item = _Kept(topic, data, log_time_ns, publish_time_ns)
        if not self._settings.snapshot_duration:
            self.messages += self.bag.write_serialized(*item)
            return ""
        self._keep(item)
        after_ns = round(self._settings.snapshot_after * 1e9)
        if change := self._level_change(message):
            if not self._changes:
                longest_ns = round(self._settings.snapshot_duration * 1e9)
                self._latest_due_ns = log_time_ns + after_ns + longest_ns
            self._changes.append(change)
            # Further changes postpone the snapshot, but a level that flickers must not prevent it.
            self._due_ns = min(log_time_ns + after_ns, self._latest_due_ns)
        # A clock that was set back must not postpone the snapshot.
        is_waiting = 0 < self._due_ns - log_time_ns <= after_ns
        if not self._changes or is_waiting or not self._kept:
            return ""
        return self._take_changes()

    def close(self) -> str:
        """Write the snapshot that is still due, if any, and close the bag.

        Return a summary of the snapshot, or "" without one.

        Raises
        ------
        OSError
            If the bag could not be written.
        """
        written = ""
        if self._changes and self._kept:
            reason = self._take_changes()
            written = f"{reason}: {self.write_snapshot()}"
        self.bag.close()
        return written

    def _take_changes(self) -> str:
        """Return and clear the level changes that await a snapshot."""
        changes, self._changes = self._changes, []
        return ", ".join(dict.fromkeys(changes))

    def write_snapshot(self) -> str:
        """Write the kept messages to a separate file; return a summary.

        Raises
        ------
        ValueError
            If no message is kept, or ``snapshot_duration`` is 0.
        OSError
            If the bag cannot be written. Messages that fit in memory stay buffered, count as
            written, and are written later.
        """
        if not self._settings.snapshot_duration:
            raise ValueError(
                "no snapshot: snapshot_duration is 0, so every message is written immediately"
            )
        if not self._kept:
            raise ValueError("no messages received after the last snapshot")
        span_s, items = self.kept_s, list(self._kept)
        self._kept.clear()
        self.kept_bytes, self.is_short = 0, False
        self.bag.begin_next_file(items[0].log_time_ns)
        count = sum(self.bag.write_serialized(*item) for item in items)
        self.bag.flush()
        self.messages += count
        self.snapshots += 1
        if most := self._settings.max_snapshots_size:
            self.bag.limit_size(most)
        if failure := self.bag.failure:
            lost = len(items) - count
            more = f"; {counted(lost, 'message')} dropped because memory is full" if lost else ""
            raise OSError(
                f"{count} messages ({span_s:.3f} s) are buffered in memory and not written yet: "
                f"{failure}{more}"
            )
        return f"{count} messages ({span_s:.3f} s) written to {self.bag.file_path}"

    def _keep(self, item: _Kept) -> None:
        """Keep a message and drop old ones; dropped states are repeated at the start of a file."""
        self._kept.append(item)
        self.kept_bytes += item.size
        settings = self._settings
        duration_s = settings.snapshot_duration
        if self._changes:
            # The snapshot is due within this time, and covers the time before the first change.
            duration_s += settings.snapshot_duration + settings.snapshot_after
        duration_ns = round(duration_s * 1e9)
        while self._kept:
            # If the clock was set back, no message counts as old.
            is_old = item.log_time_ns - self._kept[0].log_time_ns > duration_ns
            if not is_old and self.kept_bytes <= settings.max_cache_size:
                break
            self.is_short |= not is_old
            gone = self._kept.popleft()
            self.kept_bytes -= gone.size
            self.bag.note_state(gone.topic, gone.data, gone.publish_time_ns or gone.log_time_ns)

    def _read(self, topic: str, data: bytes) -> Any:
        """Return the decoded message; None if it is malformed or its type is not evaluated."""
        kind = self.bag.topics[topic].message_class
        try:
            return deserialize_message(data, kind) if issubclass(kind, _READ) else None
        except Exception:  # the middleware raises various errors for malformed messages
            return None

    def _level_change(self, message: Any) -> str:
        """Return the level changes in a message, or ""; the first level is not a change."""
        levels: dict[str, int] = {}
        if isinstance(message, DiagnosticArray) and self._settings.snapshot_levels == "all":
            levels = {item.name: ord(item.level) for item in message.status}
        elif isinstance(message, Health | HealthSummary):
            # Both topics publish the same level.
            levels = {f"health of {message.actuator_id}": message.level}
        changes = []
        for name, level in levels.items():
            before = self._levels.get(name, level)
            if level != before and not name.startswith(self._status_prefix):
                changes.append(f"{name} from {_word(before)} to {_word(level)}")
        self._levels |= levels
        return ", ".join(changes)


def _word(level: int) -> str:
    return LEVEL_NAMES[level] if level < len(LEVEL_NAMES) else str(level)
