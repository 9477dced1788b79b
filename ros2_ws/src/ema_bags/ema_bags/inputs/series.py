# SPDX-License-Identifier: Apache-2.0
"""Mapped series of tables and topics, and joining of topics."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.field_path import FieldPath
from ema_bags.inputs.mapping import CLOCKS, EPOCHS, TIMES_NS, ColumnMapping
from ema_core.wording import counted

NO_STAMP: Final = -(2**63)
"""Stamp of a sample without a stamp [ns]."""

_WIDEST: Final = 10.0


@dataclass(frozen=True, eq=False)
class Series:
    """Samples of one table or topic, in the order they arrived."""

    stamps_ns: NDArray[np.int64]
    """Stamps of the samples, ``(n,)`` [ns]; ``NO_STAMP`` where missing."""
    arrivals_ns: NDArray[np.int64]
    """Publication times, or reception times if unknown, ``(n,)`` [ns]."""
    values: Mapping[str, NDArray[np.float64]]
    """Source values by key, ``(n,)`` each."""

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def __getitem__(self, part: slice | NDArray[np.intp]) -> Self:
        values = {key: values[part] for key, values in self.values.items()}
        return type(self)(self.stamps_ns[part], self.arrivals_ns[part], values)

    def __add__(self, later: "Series") -> "Series":
        return Series(
            np.concatenate([self.stamps_ns, later.stamps_ns]),
            np.concatenate([self.arrivals_ns, later.arrivals_ns]),
            {
                key: np.concatenate([values, later.values[key]])
                for key, values in self.values.items()
            },
        )

    @property
    def is_stamped(self) -> bool:
        """Whether any sample has a stamp."""
        return bool(np.any(self.stamps_ns != NO_STAMP))

    def stamped(self) -> tuple[NDArray[np.int64], int]:
        """Return sample stamps, ``(n,)`` [ns], and the number estimated from arrival times.

        A missing stamp is the arrival time minus the median delay of the stamped samples.
        """
        missing = self.stamps_ns == NO_STAMP
        if not np.any(missing):
            return self.stamps_ns, 0
        delay = np.median((self.arrivals_ns - self.stamps_ns)[~missing])
        stamps = np.where(missing, self.arrivals_ns - np.int64(delay), self.stamps_ns)
        return stamps, int(np.count_nonzero(missing))


@dataclass
class _Topic:
    """Field readers of one topic, and samples not yet taken."""

    clock: FieldPath | None
    readers: dict[str, tuple[FieldPath, str]] = field(default_factory=dict)
    rows: list[tuple[int, int, list[float]]] = field(default_factory=list)

    def taken(self) -> Series:
        rows, self.rows = self.rows, []
        stamps, arrivals, values = zip(*rows, strict=True) if rows else ((), (), ())
        columns = np.array(values, dtype=float).reshape(len(rows), len(self.readers)).T
        return Series(
            np.array(stamps, dtype=np.int64),
            np.array(arrivals, dtype=np.int64),
            dict(zip(self.readers, np.ascontiguousarray(columns), strict=True)),
        )


class Collector:
    """Reads the mapped fields of live or recorded messages.

    Parameters
    ----------
    mapping
        Mapping whose sources are topics.

    Attributes
    ----------
    types
        Message types by topic; empty if the mapping does not state the type.
    reason
        Reason why the latest rejected message was rejected; empty if none was.
    rejected
        Number of rejected messages.

    Raises
    ------
    ValueError
        If a field path or the clock is invalid.
    """

    def __init__(self, mapping: ColumnMapping) -> None:
        self.reason = ""
        self.rejected = 0
        source = mapping.clock.source or "header"
        self._sent_first = source != "arrival"
        self._reads_header = source == "header"
        unit = mapping.clock.unit
        if unit not in TIMES_NS:
            raise ValueError(f"clock.unit = {unit}: expected {', '.join(TIMES_NS)} of a field")
        self._clock_unit, self._clock_epoch = TIMES_NS[unit], EPOCHS.get(unit, 0)
        clock = None if source in CLOCKS else FieldPath(source)
        self._topics: dict[str, _Topic] = {}
        self._names: dict[str, Any] = {}
        self.types: dict[str, str] = {}
        for key, text, item in mapping.wanted():
            # Only messages with the position need the clock field.
            is_primary = item.topic == mapping.position.topic
            topic = self._topics.setdefault(item.topic, _Topic(clock if is_primary else None))
            self.types[item.topic] = self.types.get(item.topic) or item.type
            if item.names_topic:
                self._names[item.names_topic] = None
            topic.readers[key] = FieldPath(text, item.joint or mapping.joint), item.names_topic

    @property
    def names_topics(self) -> list[str]:
        """Topics with element names for values on other topics."""
        return list(self._names)

    @property
    def topics(self) -> list[str]:
        """Mapped topics, including topics with names."""
        return [*self._topics, *self._names]

    def add(self, topic: str, message: Any, sent_ns: int, received_ns: int) -> None:
        """Add a message; it is counted as rejected if it lacks a mapped field.

        Messages of topics that are not mapped are ignored.

        Parameters
        ----------
        sent_ns
            Publication time [ns]; 0 if unknown.
        received_ns
            Reception time [ns].
        """
        if topic in self._names:
            self._names[topic] = message
        if topic not in self._topics:
            return
        collected = self._topics[topic]
        try:
            stamp = self._stamp(collected, message)
            row = [self._value(message, *reader) for reader in collected.readers.values()]
        except ValueError as error:
            self.rejected += 1
            self.reason = f"{topic}: {error}"
            return
        collected.rows.append(
            (stamp, sent_ns if sent_ns and self._sent_first else received_ns, row)
        )

    def take(self) -> dict[str, Series]:
        """Return the series collected since the previous call, by topic."""
        return {name: topic.taken() for name, topic in self._topics.items()}

    def problem(self) -> str:
        """Return the number of rejected messages and the latest reason, or ""."""
        return f"{counted(self.rejected, 'message')} rejected: {self.reason}" * bool(self.rejected)

    def _value(self, message: Any, path: FieldPath, names_topic: str) -> float:
        names = self._names.get(names_topic)
        if names_topic and names is None:
            raise ValueError(f"no names received on {names_topic} yet")
        return path.value(message, names)

    def _stamp(self, topic: _Topic, message: Any) -> int:
        if topic.clock is not None:
            return round((topic.clock.value(message) - self._clock_epoch) * self._clock_unit)
        header = getattr(message, "header", None)
        if not self._reads_header or header is None:
            return NO_STAMP
        return header.stamp.sec * 1_000_000_000 + header.stamp.nanosec or NO_STAMP


def join_topics(
    by_topic: Mapping[str, Series], mapping: ColumnMapping, stamps_ns: NDArray[np.int64]
) -> dict[str, NDArray[np.float64]]:
    """Return the values of all sources at the position samples.

    Arrays are keyed as in ``ColumnMapping.wanted``. Each is ``(n,)``, NaN where a source has no
    value.

    Parameters
    ----------
    by_topic
        Series by topic. Position samples beyond the number of stamps are ignored.
    stamps_ns
        Stamps of the position samples, ``(n,)`` [ns].
    """
    primary = by_topic[mapping.position.topic][: len(stamps_ns)]
    raw = dict(primary.values)
    for key, _, item in mapping.wanted():
        if item.topic == mapping.position.topic:
            continue
        source = by_topic[item.topic]
        # Compare unstamped series by publication time: the stamp and transport clocks may differ,
        # and a late control loop delays command and position equally.
        times, at = source.arrivals_ns, primary.arrivals_ns
        if source.is_stamped:
            times, at = source.stamped()[0], stamps_ns
        order = np.argsort(times, kind="stable")
        value_at = _held if item.between == "hold" else _between
        raw[key] = value_at(times[order], source.values[key][order], at)
    return raw


def value_at(
    series: Series, key: str, at: NDArray[np.int64], *, holds: bool
) -> NDArray[np.float64]:
    """Return values of a series at arrival times ``at`` [ns]: the latest, or interpolated.

    Both are ``(n,)``. Values are NaN before the first sample and, if interpolated, in gaps and
    after the last sample.
    """
    order = np.argsort(series.arrivals_ns, kind="stable")
    times, values = series.arrivals_ns[order], series.values[key][order]
    return (_held if holds else _between)(times, values, at)


def _held(
    times: NDArray[np.int64], values: NDArray[np.float64], at: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the most recent value at each time; NaN before the first."""
    return np.concatenate([[np.nan], values])[np.searchsorted(times, at, side="right")]


def _between(
    times: NDArray[np.int64], values: NDArray[np.float64], at: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Interpolate linearly; return NaN in gaps and outside the samples."""
    if len(times) < 2:
        return np.full(len(at), np.nan)
    right = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
    width = times[right] - times[right - 1]
    usual = max(float(np.median(np.diff(times))), 1.0)
    is_near = (at >= times[0]) & (at <= times[-1]) & (width <= _WIDEST * usual)
    offsets = (times - times[0]).astype(float)
    return np.where(is_near, np.interp((at - times[0]).astype(float), offsets, values), np.nan)
