# SPDX-License-Identifier: Apache-2.0
"""Reading of joint state messages, once for all joints of a robot."""

from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.field_path import FieldPath
from ema_bags.inputs.joint_messages import joint_reader, names_of
from ema_bags.inputs.mapping import CLOCKS, ColumnMapping, Source
from ema_bags.inputs.series import NO_STAMP, Series
from ema_core.wording import counted

_MOST_ORDERS: Final = 100
# Time without the joint after which it is missing: other publishers may share the topic.
_MISSING_NS: Final = 1_000_000_000


def reads_joint_states(mapping: ColumnMapping) -> bool:
    """Return whether all mapped quantities are fields of messages that name their joints.

    The payload may be any number on a separate topic, which all joints share.
    """
    return mapping.clock.source in ("", *CLOCKS) and all(
        _is_common(mapping, item)
        or (joint_reader(text) is not None and not (item.joint or item.names_topic))
        for _, text, item in mapping.wanted()
    )


def _is_common(mapping: ColumnMapping, item: Source) -> bool:
    """Return whether a source is a payload on a separate topic."""
    of_joints = {source.topic for _, source in mapping.telemetry_sources()}
    return item is mapping.payload and item.topic not in of_joints and not item.names_topic


class _Row(NamedTuple):
    """Values of one message."""

    stamp_ns: int
    """Stamp, or ``NO_STAMP`` [ns]."""
    arrival_ns: int
    """Publication time, or reception time if unknown [ns]."""
    order: NDArray[np.intp]
    """Index of each joint in the message, -1 if absent."""
    values: list[Any]
    """Array of each mapped field."""


class _Topic:
    """Mapped fields of one topic, and messages not yet distributed."""

    def __init__(self, *, is_common: bool) -> None:
        self.is_common = is_common  # one value for all joints
        self.fields: dict[str, str] = {}
        self.readers: list[Callable[[Any], Any]] = []
        self.orders: dict[tuple[str, ...], NDArray[np.intp]] = {}
        self.rows: list[_Row] = []

    def order_of(self, names: tuple[str, ...], joints: Sequence[str]) -> NDArray[np.intp]:
        """Return the index of each joint among the names of a message, -1 if absent."""
        order = self.orders.get(names)
        if order is None:
            # If a name occurs twice, the first value is used.
            indices: dict[str, int] = {
                name: index for index, name in reversed(list(enumerate(names)))
            }
            order = np.array([indices.get(joint, -1) for joint in joints], dtype=np.intp)
            if len(self.orders) >= _MOST_ORDERS:
                self.orders.clear()
            self.orders[names] = order
        return order


class JointStates:
    """Distributes joint state messages to the series of several joints.

    Several publishers with different joints may share a topic, and the order of the joints may
    change between messages.

    Parameters
    ----------
    mapping
        Mapping that lists the joints; `reads_joint_states` must be true.
    """

    def __init__(self, mapping: ColumnMapping) -> None:
        self._joints = mapping.joints
        self._primary = mapping.position.topic
        self._first = np.zeros(len(mapping.joints), dtype=np.intp)
        self._topics: dict[str, _Topic] = {}
        self._types: dict[str, str] = {}
        for key, text, item in mapping.wanted():
            is_common = _is_common(mapping, item)
            topic = self._topics.setdefault(item.topic, _Topic(is_common=is_common))
            reader = FieldPath(text, item.joint).value if is_common else joint_reader(text)
            assert reader is not None
            topic.fields[key] = text
            topic.readers.append(reader)
            self._types[item.topic] = self._types.get(item.topic) or item.type
        self._reads_header = mapping.clock.source in ("", "header")
        self._sent_first = mapping.clock.source != "arrival"
        self._columns = {
            joint: JointCollector(
                joint, self._types, {n: t.fields for n, t in self._topics.items()}
            )
            for joint in mapping.joints
        }

    def of_joint(self, joint: str) -> "JointCollector":
        """Return the collector of one joint."""
        return self._columns[joint]

    def remove(self, joint: str) -> None:
        """Stop collecting the samples of a joint."""
        self._columns.pop(joint, None)

    def add(self, topic: str, message: Any, sent_ns: int, received_ns: int) -> None:
        """Add a message of a topic; other topics are ignored.

        Parameters
        ----------
        topic
            Topic of the message.
        message
            A message that names its joints, such as ``sensor_msgs/msg/JointState``.
        sent_ns, received_ns
            Publication time (0 if unknown) and reception time [ns].
        """
        collected = self._topics.get(topic)
        if collected is None:
            return
        stamp = NO_STAMP
        if self._reads_header and hasattr(message, "header"):
            stamp_of = message.header.stamp
            stamp = stamp_of.sec * 1_000_000_000 + stamp_of.nanosec or NO_STAMP
        arrival = sent_ns if sent_ns and self._sent_first else received_ns
        if collected.is_common:
            order = self._first
            try:
                values = [[read(message)] for read in collected.readers]
            except ValueError:  # another message on the same topic, without the element
                return
        else:
            order = collected.order_of(names_of(message), self._joints)
            values = [read(message) for read in collected.readers]
        collected.rows.append(_Row(stamp, arrival, order, values))

    def share(self) -> None:
        """Distribute the messages received since the previous call to the joints."""
        for name, topic in self._topics.items():
            rows, topic.rows = topic.rows, []
            first = 0
            for last in range(1, len(rows) + 1):
                # Convert consecutive messages with the same order of names together.
                if last == len(rows) or _form(rows[last]) != _form(rows[first]):
                    self._share(name, rows[first:last])
                    first = last

    def _share(self, topic: str, rows: Sequence[_Row]) -> None:
        stamps = np.array([row.stamp_ns for row in rows], dtype=np.int64)
        arrivals = np.array([row.arrival_ns for row in rows], dtype=np.int64)
        keys = self._topics[topic].fields
        # (n, joints in the message) per field; (n, 0) if the messages have no values for it.
        tables = [np.array([row.values[k] for row in rows], dtype=float) for k in range(len(keys))]
        for index, joint in zip(rows[0].order, self._joints, strict=True):
            columns = self._columns.get(joint)
            if columns is None:
                continue
            if index < 0:
                if topic == self._primary:
                    columns.miss(arrivals)
                continue
            values = {
                key: np.ascontiguousarray(table[:, index])
                if index < table.shape[1]
                else np.full(len(rows), np.nan)
                for key, table in zip(keys, tables, strict=True)
            }
            columns.give(topic, Series(stamps, arrivals, values))
            if topic == self._primary:
                columns.find()


def _form(row: _Row) -> tuple[int, ...]:
    """Return a key that is equal for rows that can be converted together."""
    return (id(row.order), *map(len, row.values))


class JointCollector:
    """Collector of one joint; provides the `Collector` methods that a bridge uses.

    Parameters
    ----------
    joint
        Name of the joint in the messages.
    types
        Message type by topic; empty if the mapping does not state the type.
    fields
        Mapped fields of each topic, keyed as in ``ColumnMapping.wanted``.

    Attributes
    ----------
    rejected
        Number of messages on the topic of the position that lack the joint.
    """

    def __init__(
        self, joint: str, types: Mapping[str, str], fields: Mapping[str, Mapping[str, str]]
    ) -> None:
        self.rejected = 0
        self._is_received = False
        # First and latest arrival of the messages since the latest one with the joint [ns].
        self._missing_ns: tuple[int, int] | None = None
        self._joint = joint
        self._types = types
        no_stamps = np.empty(0, dtype=np.int64)
        self._empty = {
            topic: Series(no_stamps, no_stamps, {key: np.empty(0) for key in keys})
            for topic, keys in fields.items()
        }
        self._series: dict[str, list[Series]] = {topic: [] for topic in fields}

    @property
    def topics(self) -> list[str]:
        """The mapped topics."""
        return list(self._series)

    @property
    def types(self) -> Mapping[str, str]:
        """Message type by topic; empty if the mapping does not state the type."""
        return self._types

    @property
    def names_topics(self) -> list[str]:
        """Empty list, because joint states contain the names."""
        return []

    def give(self, topic: str, series: Series) -> None:
        """Append a series of samples of a topic."""
        self._series[topic].append(series)

    def find(self) -> None:
        """Record that a message on the position topic contains the joint."""
        self._is_received, self._missing_ns = True, None

    def miss(self, arrivals_ns: NDArray[np.int64]) -> None:
        """Count messages that lack the joint, given their arrival times [ns]."""
        self.rejected += len(arrivals_ns)
        first_ns, _ = self._missing_ns or (int(arrivals_ns[0]), 0)
        self._missing_ns = first_ns, int(arrivals_ns[-1])

    def take(self) -> dict[str, Series]:
        """Return the series collected since the previous call, by topic."""
        collected = {
            topic: sum(series, start=self._empty[topic]) for topic, series in self._series.items()
        }
        self._series = {topic: [] for topic in self._series}
        return collected

    def problem(self) -> str:
        """Return a text that states since when the messages lack the joint.

        It is "" if they have the joint, or have lacked it for less than 1 s.
        """
        if self._missing_ns is None:
            return ""
        if not self._is_received:
            return f"joint {self._joint!r} is missing in all {counted(self.rejected, 'message')}"
        first_ns, last_ns = self._missing_ns
        if last_ns - first_ns < _MISSING_NS:
            return ""
        since = datetime.fromtimestamp(first_ns * 1e-9, UTC)
        return (
            f"joint {self._joint!r} is missing in the messages since {since:%Y-%m-%d %H:%M:%S} UTC"
        )
