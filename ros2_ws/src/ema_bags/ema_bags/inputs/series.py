"""What one table or topic holds of what a mapping wants."""

from collections.abc import Mapping as Columns
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.field_path import FieldPath
from ema_bags.inputs.mapping import CLOCKS, Mapping
from ema_bags.inputs.units import TIMES_NS
from ema_core.wording import counted

NO_STAMP: Final = -(2**63)
"""Stamp of a sample that carries none [ns]."""


@dataclass(frozen=True, eq=False)
class Series:
    """Samples of one table or topic, in the order they came.

    Attributes
    ----------
    stamps_ns
        Stamps that they carry, ``NO_STAMP`` where there is none, ``(n,)`` [ns].
    arrivals_ns
        When they were sent or, where that is not known, received, ``(n,)`` [ns].
    values
        By key, ``(n,)`` each, as the source gives them.
    """

    stamps_ns: NDArray[np.int64]
    arrivals_ns: NDArray[np.int64]
    values: Columns[str, NDArray[np.float64]]

    def __len__(self) -> int:
        return len(self.stamps_ns)


class _Topic:
    """Samples of one topic as they come."""

    def __init__(self, clock: FieldPath | None) -> None:
        self.clock = clock
        self.readers: dict[str, tuple[FieldPath, str]] = {}
        self.clear()

    def clear(self) -> None:
        self.stamps: list[int] = []
        self.arrivals: list[int] = []
        self.values: dict[str, list[float]] = {key: [] for key in self.readers}


class Collector:
    """Reads what a mapping wants from messages as they come, live or from a bag.

    Parameters
    ----------
    mapping
        Mapping whose sources are topics.

    Attributes
    ----------
    refused
        How many messages do not have what is wanted.
    reason
        Why the latest of them was refused; empty without any.

    Raises
    ------
    ValueError
        When a path or the clock is impossible.
    """

    def __init__(self, mapping: Mapping) -> None:
        self.refused = 0
        self.reason = ""
        self._sent_first = mapping.clock.source != "arrival"
        source = mapping.clock.source or "header"
        clock = FieldPath(source) if source not in CLOCKS else None
        self._reads_header = source == "header"
        self._clock_unit = TIMES_NS[mapping.clock.unit]
        self._topics: dict[str, _Topic] = {}
        self._names: dict[str, Any] = {}
        self.types: dict[str, str] = {}
        for key, text, item in mapping.wanted():
            # Only the clock of the position: other messages need not have such a field.
            is_primary = item.topic == mapping.position.topic
            topic = self._topics.setdefault(item.topic, _Topic(clock if is_primary else None))
            self.types[item.topic] = self.types.get(item.topic) or item.type
            if item.names_topic:
                self._names.setdefault(item.names_topic, None)
            path = FieldPath(text, item.joint or mapping.joint)
            topic.readers[key] = (path, item.names_topic)
        for topic in self._topics.values():
            topic.clear()

    @property
    def names_topics(self) -> list[str]:
        """Topics on which names of values are published apart from them."""
        return list(self._names)

    @property
    def topics(self) -> list[str]:
        """Topics that are wanted, those of names as well."""
        return [*self._topics, *self._names]

    def add(self, topic: str, message: Any, sent_ns: int, received_ns: int) -> None:
        """Take a message; one that does not have what is wanted is counted and left out.

        Parameters
        ----------
        sent_ns
            When it was sent; 0 where that is not known [ns].
        received_ns
            When it was received [ns].
        """
        if topic in self._names:
            self._names[topic] = message
        if topic not in self._topics:
            return
        own = self._topics[topic]
        arrival = sent_ns if sent_ns and self._sent_first else received_ns
        try:
            stamp = self._stamp(own, message)
            row = {}
            for key, (path, names) in own.readers.items():
                if names and self._names[names] is None:
                    raise ValueError(f"no names on {names} yet")
                row[key] = path.value(message, self._names.get(names))
        except ValueError as error:
            self.refused += 1
            self.reason = f"{topic}: {error}"
            return
        own.stamps.append(stamp)
        own.arrivals.append(arrival)
        for key, value in row.items():
            own.values[key].append(value)

    def series(self) -> dict[str, Series]:
        """Return what has been collected, by topic."""
        return {name: _series_of(topic) for name, topic in self._topics.items()}

    def take(self) -> dict[str, Series]:
        """Return what has been collected since the last time, by topic."""
        found = self.series()
        for topic in self._topics.values():
            topic.clear()
        return found

    def problem(self) -> str:
        """Return how many messages were refused, and why; empty without any."""
        if not self.refused:
            return ""
        return f"{counted(self.refused, 'message')} left out: {self.reason}"

    def _stamp(self, topic: _Topic, message: Any) -> int:
        if topic.clock is not None:
            return round(topic.clock.value(message) * self._clock_unit)
        header = getattr(message, "header", None)
        if not self._reads_header or header is None:
            return NO_STAMP
        return header.stamp.sec * 1_000_000_000 + header.stamp.nanosec or NO_STAMP


def _series_of(topic: _Topic) -> Series:
    return Series(
        np.array(topic.stamps, dtype=np.int64),
        np.array(topic.arrivals, dtype=np.int64),
        {key: np.array(values, dtype=float) for key, values in topic.values.items()},
    )
