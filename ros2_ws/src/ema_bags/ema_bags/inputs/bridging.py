# SPDX-License-Identifier: Apache-2.0
"""Conversion of live messages to telemetry."""

from collections import deque
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.arrival import ArrivalClock
from ema_bags.inputs.defects import (
    find_defects,
    not_finite,
    other_rate,
    refused,
    stream_defects,
    withholding,
)
from ema_bags.inputs.importing import SampleStream, uses_arrival
from ema_bags.inputs.input_defect import InputDefect
from ema_bags.inputs.joint_finder import MOST_JOINTS
from ema_bags.inputs.joint_sources import EFFORT_UNIT
from ema_bags.inputs.joint_states import JointCollector
from ema_bags.inputs.mapping import ColumnMapping
from ema_bags.inputs.ordering import settled_samples, sorting_order
from ema_bags.inputs.publishers import two_publishers
from ema_bags.inputs.rate import Rate, find_rate
from ema_bags.inputs.resampling import Losses
from ema_bags.inputs.series import Collector, Series
from ema_bags.inputs.temperature import MeasuredRise
from ema_core.acquisition import EFFORT_UNITS
from ema_core.description import ActuatorDescription
from ema_core.quantity import Checked, quantity, text, texts
from ema_core.telemetry import COLUMNS, Telemetry

LEAST_SAMPLES: Final = 40
_LOOK_BACK_S: Final = 10.0
_NOT_FINITE_S: Final = 3.0
# Time between two checks for defects [s]: during the first ``_LOOK_BACK_S``, and later.
_CHECK_S: Final = 0.2
_RECHECK_S: Final = 2.0
_MOST_WAITING: Final = 200_000
# The rate has changed if the median step differs from the period by more than this factor.
_NEW_RATE: Final = 1.5
# Parts of the latest arrivals; their mean steps are hardly changed by bursts.
_ARRIVAL_PARTS: Final = 8
# Earliness of the latest arrivals that shows a faster rate [s].
_EARLY_S: Final = 0.05
_BLOCK_SAMPLES: Final = 20
_SLOW_BLOCK_S: Final = 0.1


class _Part(NamedTuple):
    """Samples converted together, and the loss counts before them."""

    stamps_ns: NDArray[np.int64]
    columns: dict[str, NDArray[np.float64]]
    losses: Losses
    rebuilt: int


@dataclass(frozen=True)
class BridgeSettings(Checked):
    """Settings of a bridge."""

    mapping_file: str = text(
        "", "YAML file that maps topics to telemetry; empty: all joints of all joint state topics"
    )
    joints: tuple[str, ...] = texts(
        "without a mapping: patterns of the actuators to bridge, such as left/*; empty: all"
    )
    state_topics: tuple[str, ...] = texts(
        "without a mapping: joint state topics to read; empty: all in the graph"
    )
    most_actuators: int = quantity(
        MOST_JOINTS, "-", 1, 10_000, "without a mapping: largest number of joints to bridge"
    )
    effort_unit: str = text(
        EFFORT_UNIT, "without a mapping: unit of the effort of revolute joints", EFFORT_UNITS
    )
    actuator_file: str = text(
        "",
        "actuator file; {joint} in its name is replaced by each joint of the mapping; empty: the "
        "built-in actuator, or unknown drives if there are several joints or no mapping",
    )
    block_s: float = quantity(
        0.01,
        "s",
        1e-3,
        1.0,
        "block duration; blocks have at least 20 samples or last 0.1 s, whichever is shorter",
    )
    learn_s: float = quantity(
        1.0, "s", 0.1, 60.0, "initial time during which the sample rate is measured"
    )
    wait_s: float = quantity(
        0.3,
        "s",
        0.0,
        10.0,
        "longest time a position sample waits for earlier values on other topics",
    )


class Bridge:
    """Converts live messages to telemetry, with a short delay.

    The sample rate is measured during the first ``learn_s``; samples from this time are kept. If a
    defect would make estimates wrong and is certain, telemetry is withheld until the defect
    disappears. While more motion may still refute the defect, telemetry is published and checked
    again.

    Parameters
    ----------
    mapping
        Mapping whose sources are topics.
    description
        Description of the actuator; its sample period and acquisition are replaced.
    settings
        Waiting times and block length.
    collector
        Reader of the messages; by default, a new one for this mapping.

    Attributes
    ----------
    collector
        Reader of the messages, with their topics, types and rejected messages.
    rate
        Sample rate; None until measured.
    defects
        Defects found in the samples of the last 10 s.
    checked
        Number of samples checked for defects, whether published or withheld.
    withheld
        Number of samples withheld because of a defect.

    Raises
    ------
    ValueError
        If the sources are table columns, or a field path is invalid.
    """

    def __init__(
        self,
        mapping: ColumnMapping,
        description: ActuatorDescription,
        settings: BridgeSettings,
        collector: Collector | JointCollector | None = None,
    ) -> None:
        if mapping.is_table:
            raise ValueError(
                "position has no topic: expected a mapping of topics, not of table columns"
            )
        self.mapping = mapping
        self._description = description
        self.settings = settings
        self.collector = collector or Collector(mapping)
        self.rate: Rate | None = None
        self.defects: list[InputDefect] = []
        self.checked = self.withheld = 0
        self._stream: SampleStream | None = None
        self._clock: ArrivalClock | None = None
        self._filled = 0
        self._waiting = self.collector.take()
        # Final stamps of the first waiting samples, and the number of samples passed to the clock.
        self._settled = np.empty(0, dtype=np.int64)
        self._stamped = 0
        self._before_ns: int | None = None
        # Latest converted samples, kept to check them for defects.
        self._latest: deque[_Part] = deque()
        self._unchecked = 0
        # Latest stamps, or arrivals if stamps are rebuilt, for detecting a rate change [ns].
        self._recent_ns = np.empty(0, dtype=np.int64)

    @property
    def description(self) -> ActuatorDescription | None:
        """Description of the telemetry; None until the sample rate has been measured."""
        return self._stream.description if self._stream else None

    @property
    def block_s(self) -> float:
        """Time between two blocks [s].

        Blocks have at least 20 samples, or last 0.1 s, because each block has a fixed cost. Until
        the rate is measured, this is ``block_s`` of the settings.
        """
        block_s = self.settings.block_s
        if self.description is None:
            return block_s
        return max(block_s, min(_BLOCK_SAMPLES * self.description.sample_period, _SLOW_BLOCK_S))

    @property
    def losses(self) -> Losses:
        """Lost and irregular samples since the rate was measured."""
        return self._stream.losses if self._stream else Losses()

    @property
    def rebuilt(self) -> int:
        """Number of stamps reconstructed from arrival times."""
        return (self._clock.rebuilt if self._clock else 0) + self._filled

    @property
    def refused(self) -> list[InputDefect]:
        """Certain errors; while there are any, telemetry is withheld."""
        return withholding(self.defects, self.mapping)

    @property
    def uncertain(self) -> list[InputDefect]:
        """Errors that more motion may still confirm or refute; telemetry is published meanwhile."""
        return [item for item in refused(self.defects, self.mapping) if not item.is_certain]

    @property
    def other_rate_hz(self) -> float:
        """Mean rate of the latest samples [Hz] if the telemetry has another rate; else 0.

        The latest samples cover up to twice ``learn_s``.
        """
        span_s = 1e-9 * float(np.ptp(self._recent_ns)) if len(self._recent_ns) else 0.0
        if self._stream is None or not span_s:
            return 0.0
        mean_s = span_s / (len(self._recent_ns) - 1)
        return 1.0 / mean_s if self._is_other(mean_s) else 0.0

    def take_rises(self) -> list[MeasuredRise]:
        """Return the temperature rises since the previous call, at most one per second."""
        sampler = self._stream.rises if self._stream else None
        return sampler.take() if sampler else []

    def advance(self) -> list[Telemetry]:
        """Return blocks of telemetry completed since the previous call.

        Raises
        ------
        ValueError
            If the measured sample rate is out of range.
        """
        primary = self.mapping.position.topic
        for topic, series in self.collector.take().items():
            if len(series):
                self._waiting[topic] += series
        if self._stream is None:
            waiting = self._waiting[primary] = self._waiting[primary][-_MOST_WAITING:]
            self._stream = self._learn(waiting)
            if self._stream is None:
                return []
        self._stamp(self._waiting[primary])
        if self._has_new_rate():
            self._restart_learning()
            return []
        count = self._complete(self._ordered())
        stamps = self._settled[:count]
        if not len(stamps):
            return []
        self._before_ns = int(stamps[-1])
        counts = replace(self.losses), self.rebuilt
        settled, columns, runs = self._stream.push(self._waiting, stamps)
        self._forget(len(stamps))
        if not len(settled):
            return []
        self._check(_Part(settled, columns, *counts))
        if self.refused:
            self.withheld += sum(len(run.stamps_ns) for run in runs)
            return []
        h = self._stream.description.sample_period
        blocks: list[Telemetry] = []
        for run in runs:
            # Split evenly, so that no short block remains.
            samples = len(run.stamps_ns)
            count = max(1, samples // max(1, round(self.block_s / h)))
            blocks += self._stream.blocks(run, -(-samples // count) * h)
        return blocks

    def _learn(self, primary: Series) -> SampleStream | None:
        """Measure the sample rate and return a new stream.

        Return None until at least 40 samples have arrived and cover ``learn_s``.
        """
        if (
            len(primary) < LEAST_SAMPLES
            or 1e-9 * np.ptp(primary.arrivals_ns) < self.settings.learn_s
        ):
            return None
        by_arrival = uses_arrival(primary, self.mapping)
        times = primary.arrivals_ns if by_arrival else primary.stamped()[0]
        rate = find_rate(times, self.mapping.clock.rate_hz)
        if by_arrival:
            self._clock = ArrivalClock(rate.measured_period)
            rate = replace(rate, jitter=0.0)
        stream = SampleStream(self.mapping, self._description, rate)
        self.rate = rate
        return stream

    def _has_new_rate(self) -> bool:
        """Return whether samples have arrived at a new, steady rate for at least ``learn_s``."""
        assert self._stream is not None
        recent_ns = self._recent_ns
        if self.mapping.clock.rate_hz:
            return False
        if self._clock is not None and self._clock.early_s > _EARLY_S:
            return True  # stamps computed from the old rate would be in the future
        if len(recent_ns) < LEAST_SAMPLES:
            return False
        if 1e-9 * np.ptp(recent_ns) < self.settings.learn_s:
            return False
        each = 1 if self._clock is None else (len(recent_ns) - 1) // _ARRIVAL_PARTS
        # Uneven steps indicate two publishers, or bursts, rather than a new rate.
        steps_s = 1e-9 * np.diff(recent_ns[::each]) / each
        short, usual, long = np.quantile(steps_s, (0.1, 0.5, 0.9))
        longest = max(float(long), float(np.mean(steps_s)))
        if longest > _NEW_RATE * usual or usual > _NEW_RATE * short:
            return False
        if not self._is_other(float(usual)):
            return False
        # Lost messages lengthen the mean step, but are no new rate.
        return self._clock is None or self._is_other(find_rate(recent_ns).measured_period)

    def _is_other(self, period: float) -> bool:
        """Return whether a sample period [s] differs from the nominal period by a factor of 1.5."""
        assert self._stream is not None
        nominal = self._stream.description.sample_period
        return not nominal / _NEW_RATE < period < nominal * _NEW_RATE

    def _restart_learning(self) -> None:
        """Discard the rate, and the waiting samples; measure it again from later samples."""
        self._filled = self.rebuilt
        self._stream, self._clock, self.rate, self.defects = None, None, None, []
        self._waiting = {topic: series[len(series) :] for topic, series in self._waiting.items()}
        self._settled, self._stamped = np.empty(0, dtype=np.int64), 0
        self._recent_ns = np.empty(0, dtype=np.int64)
        self._latest.clear()
        self._unchecked = 0

    def _stamp(self, primary: Series) -> None:
        """Determine the stamps of the new samples."""
        fresh = primary[self._stamped :]
        self._stamped = len(primary)
        if self._clock is not None:
            stamps = self._clock.push(fresh.arrivals_ns)
            self._recent_ns = self._latest_stamps(fresh.arrivals_ns)
        else:
            stamps, filled = fresh.stamped()
            self._filled += filled
            self._recent_ns = self._latest_stamps(stamps)
        self._settled = np.concatenate([self._settled, stamps])

    def _latest_stamps(self, stamps: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the latest stamps, including ``stamps``, for detecting a new rate [ns]."""
        recent = np.concatenate([self._recent_ns, stamps])
        # Twice ``learn_s``, so that the samples cover it for any block length.
        earliest_ns = recent[-1:] - round(2e9 * self.settings.learn_s)
        count = max(np.count_nonzero(recent > earliest_ns), LEAST_SAMPLES)
        return recent[-min(count, _MOST_WAITING) :]

    def _ordered(self) -> int:
        """Sort the waiting samples by stamp; return the number whose order is final."""
        assert self._stream is not None
        assert self.rate is not None
        if self._clock is not None:
            return len(self._settled)
        primary = self.mapping.position.topic
        order = sorting_order(self._settled)
        if order is not None:
            self._settled = self._settled[order]
            self._waiting[primary] = self._waiting[primary][order]
            self._stream.losses.reordered += int(np.count_nonzero(order != np.arange(len(order))))
        return settled_samples(self._settled, self._before_ns, 1e9 * self.rate.measured_period)

    def _complete(self, count: int) -> int:
        """Return the number of samples for which all other topics have caught up."""
        primary = self._waiting[self.mapping.position.topic]
        # Do not wait for temperatures and payloads, which may be slow.
        awaited = {item.topic for _, item in self.mapping.telemetry_sources()}
        awaited_series = [
            series
            for topic, series in self._waiting.items()
            if series is not primary and topic in awaited
        ]
        if not count or not awaited_series:
            return count
        latest = min(
            int(series.arrivals_ns[-1]) if len(series) else -(2**62) for series in awaited_series
        )
        # Commands may be sent only on change, so waiting is limited to ``wait_s``.
        waited = int(primary.arrivals_ns[-1]) - round(self.settings.wait_s * 1e9)
        late = np.flatnonzero(primary.arrivals_ns[:count] > max(latest, waited))
        return int(late[0]) if len(late) else count

    def _forget(self, count: int) -> None:
        """Drop used samples; keep the recent history of the other topics."""
        self._settled = self._settled[count:]
        self._stamped -= count
        span_ns = round((self.settings.wait_s + 1.0) * 1e9)
        for topic, series in self._waiting.items():
            if topic == self.mapping.position.topic:
                self._waiting[topic] = series[count:]
            elif len(series):
                old = int(np.searchsorted(series.arrivals_ns, series.arrivals_ns[-1] - span_ns))
                self._waiting[topic] = series[max(0, old - 2) :]

    def _check(self, part: _Part) -> None:
        """Add converted samples, and periodically check the latest 10 s for defects."""
        assert self._stream is not None
        h = self._stream.description.sample_period
        latest = self._latest
        latest.append(part)
        while (
            sum(len(part.stamps_ns) for part in latest) - len(latest[0].stamps_ns)
            > _LOOK_BACK_S / h
        ):
            latest.popleft()
        self.checked += len(part.stamps_ns)
        self._unchecked += len(part.stamps_ns)
        if self._unchecked * h < (_CHECK_S if self.checked * h < _LOOK_BACK_S else _RECHECK_S):
            return
        self._unchecked = 0
        times = np.concatenate([part.stamps_ns for part in latest])
        columns = {
            name: np.concatenate([part.columns[name] for part in latest]) for name in COLUMNS
        }
        first, last_s = latest[0], round(_NOT_FINITE_S / h)
        assert self.rate is not None
        self.defects = [
            *other_rate(self.rate, self._description),
            *([] if self._clock else two_publishers(times)),
            *stream_defects(
                self.losses - first.losses,
                self.rebuilt - first.rebuilt,
                is_unknown=not self._description.is_modelled,
            ),
            *not_finite({name: column[-last_s:] for name, column in columns.items()}),
            *find_defects(columns, times, self.mapping, self._stream.description),
            *(self._stream.rises.defects() if self._stream.rises else ()),
        ]
