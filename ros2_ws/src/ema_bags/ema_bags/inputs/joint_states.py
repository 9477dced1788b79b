"""Reading of a robot's joint states once for all its joints."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.mapping import CLOCKS, Mapping
from ema_bags.inputs.series import NO_STAMP, Series
from ema_core.wording import counted

FIELDS: Final = ("position", "velocity", "effort")
"""Per-joint arrays of ``sensor_msgs/msg/JointState``."""

_MOST_ORDERS: Final = 100


def reads_joint_states(mapping: Mapping) -> bool:
    """Return whether all mapped quantities come from a single joint state topic."""
    return mapping.clock.source in ("", *CLOCKS) and all(
        item.topic == mapping.position.topic
        and text in FIELDS
        and not (item.joint or item.names_topic)
        for _, text, item in mapping.wanted()
    )


class JointStates:
    """Distributes joint state messages to the series of several joints.

    Several publishers with different joints may share the topic, and the order of the joints may
    change between messages.

    Parameters
    ----------
    mapping
        Mapping that lists the joints; `reads_joint_states` must be true.
    """

    def __init__(self, mapping: Mapping) -> None:
        self._topic = mapping.position.topic
        self._joints = mapping.joints
        self._keys = {key: text for key, text, _ in mapping.wanted()}
        self._reads_header = mapping.clock.source in ("", "header")
        self._sent_first = mapping.clock.source != "arrival"
        self._columns = {
            joint: JointColumns(self, joint, mapping.position.type) for joint in mapping.joints
        }
        # Index of each joint in a message, -1 if absent, by the tuple of names in the message.
        self._orders: dict[tuple[str, ...], NDArray[np.intp]] = {}
        self._rows: list[tuple[int, int, NDArray[np.intp], list[Any]]] = []

    @property
    def topic(self) -> str:
        """Joint state topic."""
        return self._topic

    def of_joint(self, joint: str) -> "JointColumns":
        """Return the collector of one joint."""
        return self._columns[joint]

    def add(self, message: Any, sent_ns: int, received_ns: int) -> None:
        """Add a message.

        Parameters
        ----------
        message
            A ``sensor_msgs/msg/JointState`` message.
        sent_ns, received_ns
            Publication time (0 if unknown) and reception time [ns].
        """
        names: tuple[str, ...] = tuple(
            getattr(message, "name", ()) or getattr(message, "joint_names", ())
        )
        order = self._orders.get(names)
        if order is None:
            # Of a name that occurs twice, the first value counts.
            places: dict[str, int] = {
                name: place for place, name in reversed(list(enumerate(names)))
            }
            order = np.array([places.get(joint, -1) for joint in self._joints], dtype=np.intp)
            if len(self._orders) >= _MOST_ORDERS:
                self._orders.clear()
            self._orders[names] = order
        stamp = NO_STAMP
        if self._reads_header and hasattr(message, "header"):
            stamp_of = message.header.stamp
            stamp = stamp_of.sec * 1_000_000_000 + stamp_of.nanosec or NO_STAMP
        arrival = sent_ns if sent_ns and self._sent_first else received_ns
        self._rows.append(
            (stamp, arrival, order, [getattr(message, field) for field in self._keys.values()])
        )

    def share(self) -> None:
        """Distribute the messages received since the previous call to the joints."""
        rows, self._rows = self._rows, []
        first = 0
        for last in range(1, len(rows) + 1):
            # Convert consecutive messages with the same order of names together.
            if last == len(rows) or _form(rows[last]) != _form(rows[first]):
                self._share(rows[first:last])
                first = last

    def _share(self, rows: Sequence[tuple[int, int, NDArray[np.intp], list[Any]]]) -> None:
        stamps = np.array([row[0] for row in rows], dtype=np.int64)
        arrivals = np.array([row[1] for row in rows], dtype=np.int64)
        order = rows[0][2]
        # (n, joints in the message) per field; (n, 0) if the messages have no values for it.
        tables = [
            np.array([row[3][k] for row in rows], dtype=float) for k in range(len(self._keys))
        ]
        for place, joint in zip(order, self._joints, strict=True):
            columns = self._columns[joint]
            if place < 0:
                columns.missed += len(rows)
                continue
            values = {
                key: np.ascontiguousarray(table[:, place])
                if place < table.shape[1]
                else np.full(len(rows), np.nan)
                for key, table in zip(self._keys, tables, strict=True)
            }
            columns.give(Series(stamps, arrivals, values))


def _form(row: tuple[int, int, NDArray[np.intp], list[Any]]) -> tuple[int, ...]:
    """Return a key that is equal for rows that can be converted together."""
    return (id(row[2]), *map(len, row[3]))


class JointColumns:
    """Collector of one joint; provides the `Collector` methods that a bridge uses.

    Attributes
    ----------
    missed
        Number of messages that lack the joint.
    """

    def __init__(self, states: JointStates, joint: str, kind: str) -> None:
        self.missed = 0
        self.received = 0
        self._states = states
        self._joint = joint
        self._kind = kind
        self._series: list[Series] = []
        self._empty = Series(
            np.empty(0, dtype=np.int64),
            np.empty(0, dtype=np.int64),
            {key: np.empty(0) for key in states._keys},
        )

    @property
    def topics(self) -> list[str]:
        """The joint state topic, as a list."""
        return [self._states.topic]

    @property
    def types(self) -> dict[str, str]:
        """Message type of the topic; empty if the mapping does not state it."""
        return {self._states.topic: self._kind}

    @property
    def names_topics(self) -> list[str]:
        """Empty list, because joint states contain the names."""
        return []

    def give(self, series: Series) -> None:
        """Append a series of samples."""
        self.received += len(series)
        self._series.append(series)

    def take(self) -> dict[str, Series]:
        """Return the series collected since the previous call, by topic."""
        series, self._series = self._series, []
        return {self._states.topic: sum(series, start=self._empty)}

    def problem(self) -> str:
        """Return a message if no received message contains the joint, else ""."""
        if self.received or not self.missed:
            return ""
        return f"joint {self._joint!r} is in none of {counted(self.missed, 'message')}"
