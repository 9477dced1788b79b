# SPDX-License-Identifier: Apache-2.0
"""The recorder node: writes received messages to a bag."""

import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from typing import Any, Final

from std_srvs.srv import Trigger

from ema_bags.bag_recorder import BagRecorder, RecorderSettings
from ema_bags.gaps import Gap
from ema_bags.recorded_topic import RecordedTopic
from ema_core.wording import counted
from ema_interfaces.msg import NodeStatus
from ema_ros.executor import WaitingCallbackGroup
from ema_ros.managed_node import ManagedNode
from ema_ros.node_parameters import declare, read
from ema_ros.run import run
from ema_ros.status import ERROR, OK, WARN, Task

_DISCOVERY_S: Final = 0.2
_MOST_NAMED: Final = 3
_STANDSTILL_S: Final = 2.0
_SYSTEM_TOPICS: Final = ("/diagnostics", "/clock")
_TRANSITION_EVENT: Final = "/transition_event"
_SHARED_TOPICS: Final = ("/rosout", "/parameter_events")


class RecorderNode(ManagedNode):
    """Records published messages as they are received.

    Parameters of the node are the fields of ``RecorderSettings``; topics are full names, or names
    relative to the namespace. The default is all topics of the namespace, /diagnostics and /clock.
    Hidden topics, /rosout and /parameter_events, which all nodes of the domain share, are recorded
    only if they are listed.

    With ``snapshot_duration``, the node keeps received messages for that time. It writes them to a
    separate file when the level of a health or of a status on /diagnostics changes, or when
    ``~/snapshot`` is called. At the end, messages still kept are written only if a snapshot is due.

    An inactive node records nothing; after reactivation, it continues in the same bag. Cleanup
    closes the bag.

    While the bag cannot be written, for example because the disk is full, the status is ERROR.
    Recording continues when there is room; status and bag report the gap. They also report if the
    recorder itself was suspended, the machine slept or a disk was slow: the missed messages are
    then unknown.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("recorder", **kwargs)
        declare(self, RecorderSettings)
        self._discovering = threading.Lock()  # guards the topics
        self._writing = threading.Lock()  # guards the bag
        self._recording = False
        self._recorded: BagRecorder | None = None

    def configure(self) -> None:
        """Create the bag."""
        self._settings = settings = read(self, RecorderSettings)
        self._wanted = self.full_topic_names(settings.topics)
        self._uses_sim_time = bool(self.get_parameter("use_sim_time").value)
        self._topics: dict[str, RecordedTopic] = {}
        self._skipped: dict[str, str] = {}
        self._trouble = ""
        self._last_call: tuple[float, int] | None = None
        self._standstills = 0
        output = settings.output or f"ema_{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
        try:
            node_name = self.get_fully_qualified_name()
            self._recorded = BagRecorder(output, settings, node_name, self.report_end)
        except FileExistsError as error:
            hint = "" if settings.overwrite else "; parameter overwrite (--replace) replaces a bag"
            raise FileExistsError(f"parameter output: {error}{hint}") from error
        self.create_service(
            Trigger, "~/snapshot", self._serve_snapshot, callback_group=WaitingCallbackGroup()
        )
        self.get_logger().info(f"recording to {self._recorded.bag.path}")

    def activate(self) -> None:
        """Discover topics and record them."""
        self._recording = True
        self.add_timer(_DISCOVERY_S, self._discover)

    def deactivate(self) -> None:
        """Stop recording."""
        self._note_standstill()
        with self._discovering:
            self._recording = False
            self._last_call = None
            self._update_publishers()
            for topic in self._topics.values():
                topic.pause()
                topic.is_received = False

    def clean_up(self) -> None:
        """Close the bag."""
        with self._writing:
            recorded, self._recorded = self._recorded, None
        if recorded is None:
            return
        path = recorded.bag.path
        try:
            if written := recorded.close():
                self.get_logger().info(written)
        except OSError as error:
            self.exit_code = 1
            raise OSError(f"{path} is incomplete: {error}") from error
        self.get_logger().info(f"closed {path} with {counted(recorded.messages, 'message')}")

    def counts(self) -> NodeStatus:
        """Return the numbers of messages that are not recorded."""
        status = NodeStatus(kind=NodeStatus.RECORDER)
        if self._recorded is not None:
            status.messages_lost = sum(topic.lost for topic in tuple(self._topics.values()))
            status.messages_without_room = sum(gap.messages for gap in self._recorded.bag.gaps)
        return status

    def tasks(self) -> list[Task]:
        """Return the status of recorded topics and of gaps."""
        recorded = self._recorded
        if recorded is None:
            return []
        bag, settings, counts = recorded.bag, self._settings, self.counts()
        topics = dict(self._topics)
        lost = {name: topic.lost for name, topic in sorted(topics.items()) if topic.lost}
        # A node that ends takes its transition events with it, which is no loss.
        gone = ", ".join(
            name
            for name, topic in topics.items()
            if not topic.has_publisher and not name.endswith(_TRANSITION_EVENT)
        )
        missing = sorted((self._wanted or set()) - topics.keys() - self._skipped.keys())
        remarks = [bag.flusher.failure] if bag.flusher.failure else []
        remarks += [f"{counted(sum(lost.values()), 'message')} lost"] if lost else []
        remarks += [f"{gone}: the publisher has disappeared"] if gone else []
        remarks += [f"{', '.join(missing)}: no publisher yet"] if missing else []
        remarks += [f"{name}: not recorded, {why}" for name, why in self._skipped.items()]
        remarks += [
            f"{name}: no messages from {', '.join(topic.incompatible)}: incompatible quality of "
            "service"
            for name, topic in topics.items()
            if topic.incompatible
        ]
        remarks += [
            f"{name}: {collision}"
            for name, topic in topics.items()
            if (collision := topic.collision)
        ]
        if recorded.is_short:
            remarks.append(
                f"max_cache_size = {settings.max_cache_size} B is enough for "
                f"{recorded.kept_s:.3g} of {settings.snapshot_duration:g} s"
            )
        if not topics and not missing:
            remarks.append("no topics are published yet")
        elif not recorded.messages and self._recording and not settings.snapshot_duration:
            remarks.append("no message received yet")
        remarks += [f"gap: {gap}" for gap in bag.gaps[-_MOST_NAMED:]]
        is_wrong = bag.failure or bag.flusher.failure or bag.removed
        level = ERROR if is_wrong else WARN if remarks else OK
        values = {
            "bag": bag.path,
            "file": bag.file_path.name,
            "messages": recorded.messages,
            "size [B]": bag.file_path.stat().st_size if bag.file_path.exists() else 0,
            "lost messages": counts.messages_lost,
            "lost by topic": ", ".join(f"{name} {count}" for name, count in lost.items()),
            "standstills": self._standstills,
            "waiting [B]": bag.waiting,
            "messages without room": counts.messages_without_room,
            "ends of threads": bag.flusher.ends,
            "topics": ", ".join(sorted(topics)),
            "publisher gone": gone,
            "not recorded": ", ".join(self._skipped),
        }
        doing = f"recording {counted(len(topics), 'topic')}" if self._recording else "paused"
        if settings.snapshot_duration:
            values |= {
                "snapshots": recorded.snapshots,
                "kept [s]": recorded.kept_s,
                "kept [B]": recorded.kept_bytes,
            }
            doing += f" for {counted(recorded.snapshots, 'snapshot')} so far"
        if bag.failure:
            doing = _write_failure(recorded)
        message = "; ".join([doing, *remarks])
        return [Task("recording", level, message, self.hardware_id, values)]

    def _is_wanted(self, name: str) -> bool:
        if self._wanted is not None:
            return name in self._wanted
        if name in _SYSTEM_TOPICS:
            return True
        prefix = self.get_namespace().rstrip("/") + "/"
        return name.startswith(prefix) and "/_" not in name and name not in _SHARED_TOPICS

    def _discover(self) -> None:
        """Record new topics, and update the publishers of all recorded topics."""
        with self._discovering:
            recorded = self._recorded
            if recorded is None or not self._recording:
                return
            self._report_trouble(recorded)
            if self._uses_sim_time and not self.get_clock().now().nanoseconds:
                return  # there are no log times before simulated time begins
            self._note_standstill()
            for name, types in self.get_topic_names_and_types():
                if self._is_wanted(name) and name not in self._topics | self._skipped:
                    self._add_topic(recorded, name, types)
            self._update_publishers()
            for name, topic in self._topics.items():
                if not topic.is_received:
                    receive: Any = partial(self._receive, name)
                    self.create_subscription(
                        topic.message_class, name, receive, topic.request, raw=True
                    )
                    topic.is_received = True

    def _note_standstill(self) -> None:
        """Report a period, if any, since the last call in which this process did not run."""
        now = time.clock_gettime(time.CLOCK_BOOTTIME), self.get_clock().now().nanoseconds
        last, self._last_call = self._last_call, now
        if last is None or now[0] - last[0] < _STANDSTILL_S:
            return
        # Simulated time may have gone back meanwhile.
        start_ns, end_ns = sorted((last[1], now[1]))
        gap = Gap(f"the recorder was suspended for {now[0] - last[0]:.1f} s", start_ns, end_ns)
        self._standstills += 1
        with self._writing:
            if self._recorded is not None:
                self._recorded.bag.note_gap(gap)
        self.get_logger().warning(str(gap))
        self.report()

    def _add_topic(self, recorded: BagRecorder, name: str, types: list[str]) -> None:
        publishers = self.get_publishers_info_by_topic(name)
        if not publishers:
            return
        try:
            topic = RecordedTopic(types, publishers)
            recorded.bag.add_topic(name, topic.message_class, topic.offer)
        except ValueError as error:
            self._skipped[name] = str(error)
            self.get_logger().warning(f"{name} is not recorded: {error}")
        else:
            self._topics[name] = topic

    def _update_publishers(self) -> None:
        for name, topic in self._topics.items():
            topic.set_publishers(self.get_publishers_info_by_topic(name))

    def _receive(self, name: str, data: bytes, information: Mapping[str, Any]) -> None:
        log_time_ns = information["received_timestamp"]
        if self._uses_sim_time or not log_time_ns:
            log_time_ns = self.get_clock().now().nanoseconds
        publish_time_ns = information["source_timestamp"] or None
        with self._writing:
            recorded = self._recorded
            if recorded is None:
                return
            reason = recorded.receive(name, data, log_time_ns, publish_time_ns)
            self._topics[name].count(data, information["publication_sequence_number"])
            if reason:
                with suppress(OSError):  # it is logged
                    self._write_snapshot(recorded, reason)

    def _write_snapshot(self, recorded: BagRecorder, reason: str) -> str:
        """Write a snapshot, and log the outcome (see ``BagRecorder.write_snapshot``)."""
        try:
            done = recorded.write_snapshot()
        except OSError as error:
            self.get_logger().error(f"{reason}: {error}")
            raise
        self.get_logger().info(f"{reason}: {done}")
        return done

    def _serve_snapshot(self, _: Any, response: Trigger.Response) -> Trigger.Response:
        with self._writing:
            if self._recorded is None:
                raise ValueError("no bag is open")
            response.message = self._write_snapshot(self._recorded, "snapshot on demand")
        response.success = True
        return response

    def _report_trouble(self, recorded: BagRecorder) -> None:
        """Log once if the bag cannot be written, and once if it can be written again."""
        bag, before = recorded.bag, self._trouble
        self._trouble = str(bag.failure or "")
        if self._trouble and not before:
            self.get_logger().error(_write_failure(recorded))
        elif before and not self._trouble:
            lost = [f"; {gap}" for gap in bag.gaps if gap.messages]
            self.get_logger().warning(f"{bag.path} can be written again{''.join(lost[-1:])}")
        if bool(before) != bool(self._trouble):
            self.report()


def _write_failure(recorded: BagRecorder) -> str:
    """Return an error text with the reason why a bag cannot be written."""
    return f"cannot write {recorded.bag.path}: {recorded.bag.failure}"


def main(args: list[str] | None = None) -> int:
    """Run the recorder."""
    return run(RecorderNode, args)
