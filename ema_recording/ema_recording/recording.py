"""Where what a recorder receives goes: into the bag, or into memory until there is a reason."""

from collections.abc import Callable
from typing import Any, Final

from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from ema_core.wording import counted
from ema_interfaces.msg import FaultEstimate
from ema_recording.level_changes import LevelChanges
from ema_recording.recorder_settings import RecorderSettings
from ema_recording.snapshot_buffer import Kept, SnapshotBuffer
from ema_recording.writer import BagWriter

CALIBRATION: Final = "calibration_id of {}"
"""Name in the metadata of a bag under which the calibration of an actuator is noted."""


class Recording:
    """A bag that is recorded; one thread at a time may use it.

    Parameters
    ----------
    path
        Where to record.
    own
        Full name of the recorder.
    on_failure
        Called as by ``BagWriter``.

    Attributes
    ----------
    messages
        How many messages were received and written.
    snapshots
        How many snapshots were written.
    kept
        What is kept for the next one; None when all is written.

    Raises
    ------
    FileExistsError, ValueError
        As of ``BagWriter``.
    """

    def __init__(
        self,
        path: str,
        settings: RecorderSettings,
        own: str,
        on_failure: Callable[[str, str], object],
    ) -> None:
        self.bag = BagWriter(
            path,
            flush_s=settings.flush_s,
            max_bytes=settings.max_bag_size,
            max_duration_s=settings.max_bag_duration,
            overwrite=settings.overwrite,
            waits_for_room=True,
            on_failure=on_failure,
        )
        self.messages = 0
        self.snapshots = 0
        self.kept: SnapshotBuffer | None = None
        if settings.snapshot_duration:
            self.kept = SnapshotBuffer(settings.snapshot_duration, settings.max_cache_size)
        self._changes = LevelChanges(own)
        self._classes: dict[str, Any] = {}

    def add_topic(self, topic: str, message_class: Any, qos: QoSProfile) -> None:
        """Add a topic, as of ``BagWriter``."""
        self.bag.add_topic(topic, message_class, qos)
        self._classes[topic] = message_class

    def receive(
        self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int | None
    ) -> str:
        """Take a message.

        Returns
        -------
        str
            Why there should be a snapshot now; empty when there is no reason.
        """
        message_class = self._classes[topic]
        if message_class is FaultEstimate:
            self._note_calibration(data)
        if self.kept is None:
            self.messages += self.bag.write_serialized(topic, data, log_time_ns, publish_time_ns)
            return ""
        for item in self.kept.append(Kept(topic, data, log_time_ns, publish_time_ns)):
            self.bag.note_state(item.topic, item.data, item.publish_time_ns or item.log_time_ns)
        change = self._changes.find(message_class, data)
        return change if len(self.kept) else ""

    def _note_calibration(self, data: bytes) -> None:
        try:
            estimate: Any = deserialize_message(data, FaultEstimate)
        except Exception:  # whatever the middleware makes of what is no message
            return
        if estimate.calibration_id:
            name = CALIBRATION.format(estimate.actuator_id)
            self.bag.custom_data[name] = estimate.calibration_id

    def write_snapshot(self) -> str:
        """Write what is kept to a file of its own, and say what was written.

        Raises
        ------
        ValueError
            When nothing is kept.
        OSError
            When the bag cannot be written: what it has room for waits in memory, is counted as
            written, and is written when it can be.
        """
        if self.kept is None:
            raise ValueError("all is written: snapshot_duration is 0")
        span_s, items = self.kept.span_s, self.kept.take()
        if not items:
            raise ValueError("nothing was received since the last snapshot")
        self.bag.begin_next_file(items[0].log_time_ns)
        count = sum(self.bag.write_serialized(*item) for item in items)
        self.bag.flush()
        self.messages += count
        self.snapshots += 1
        if failure := self.bag.failure:
            lost = len(items) - count
            more = f"; {counted(lost, 'message')} lost for want of memory" if lost else ""
            raise OSError(
                f"{count} messages of {span_s:.3f} s: waits in memory, not written: {failure}{more}"
            )
        return f"{count} messages of {span_s:.3f} s to {self.bag.file_path}"
