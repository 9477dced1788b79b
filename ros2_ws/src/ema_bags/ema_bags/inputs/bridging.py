"""Telemetry from messages as they come."""

from collections.abc import Mapping as ByTopic
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.arrival import ArrivalClock
from ema_bags.inputs.conversion import convert
from ema_bags.inputs.defects import InputDefect, find_defects, refused, stream_defects
from ema_bags.inputs.importing import blocks_of
from ema_bags.inputs.joining import join_topics, stamped, uses_arrival
from ema_bags.inputs.mapping import Mapping
from ema_bags.inputs.rate import Rate, find_rate
from ema_bags.inputs.resampling import Losses, Resampler
from ema_bags.inputs.series import Collector, Series
from ema_core.description import ActuatorDescription
from ema_core.quantity import check_quantities, quantity, text
from ema_core.telemetry import COLUMNS, Telemetry

_LEAST_SAMPLES: Final = 40
_LOOK_BACK_S: Final = 10.0
_CHECK_S: Final = 0.2
_MOST_WAITING: Final = 200_000


@dataclass(frozen=True)
class BridgeSettings:
    """What a bridge listens to, and how long it waits.

    Raises
    ------
    ValueError
        When a value is impossible.
    """

    mapping_file: str = text("", "mapping of topics to telemetry, a YAML file")
    actuator_file: str = text("", "description of the actuator; empty: the built-in one")
    block_s: float = quantity(0.01, "s", 1e-3, 1.0, "time between two blocks of telemetry")
    learn_s: float = quantity(1.0, "s", 0.1, 60.0, "time in which the rate is found, at the start")
    wait_s: float = quantity(
        0.3, "s", 0.0, 10.0, "how long a position waits at most for what was sent before it"
    )

    def __post_init__(self) -> None:
        check_quantities(self)


@dataclass
class _Kept:
    """The latest converted samples, in which defects are looked for."""

    stamps: list[NDArray[np.int64]]
    columns: list[dict[str, NDArray[np.float64]]]
    unchecked: int = 0
    samples: int = 0


class Bridge:
    """Turns messages into telemetry, with a little delay.

    The rate is found in the first ``learn_s``; nothing of these is lost. Telemetry with a defect
    that forbids estimates is withheld until the defect is gone.

    Parameters
    ----------
    mapping
        Mapping of topics.
    description
        Description of the actuator; its sample period and acquisition are replaced.
    settings
        How long to wait.

    Attributes
    ----------
    description
        Description of the telemetry; None until its rate is known.
    rate
        Rate of the samples; None until it is known.
    defects
        What is wrong.
    withheld
        Samples that were withheld as a defect forbids estimates.

    Raises
    ------
    ValueError
        When the mapping is one of columns, or a path in it is impossible.
    """

    def __init__(
        self, mapping: Mapping, description: ActuatorDescription, settings: BridgeSettings
    ) -> None:
        if mapping.is_table:
            raise ValueError("position has no topic: expected a mapping of topics, not of columns")
        self._mapping = mapping
        self._given = description
        self._settings = settings
        self._collector = Collector(mapping)
        self.description: ActuatorDescription | None = None
        self.defects: list[InputDefect] = []
        self.withheld = 0
        self.rate: Rate | None = None
        self._resampler: Resampler | None = None
        self._clock: ArrivalClock | None = None
        self._filled = 0
        self._settled = np.empty(0, dtype=np.int64)
        self._stamped = 0
        self._waiting: dict[str, Series] = {}
        self._kept = _Kept([], [])

    @property
    def topics(self) -> list[str]:
        """Topics that are wanted."""
        return self._collector.topics

    @property
    def types(self) -> ByTopic[str, str]:
        """Types of the topics where the mapping gives them, else empty."""
        return self._collector.types

    @property
    def losses(self) -> Losses:
        """What was found between the samples since the rate is known."""
        return self._resampler.losses if self._resampler else Losses()

    @property
    def rebuilt(self) -> int:
        """How many stamps were rebuilt from arrival."""
        return (self._clock.rebuilt if self._clock else 0) + self._filled

    @property
    def problem(self) -> str:
        """How many messages do not have what is wanted, and why; empty without any."""
        return self._collector.problem()

    @property
    def refused(self) -> list[InputDefect]:
        """Defects that withhold telemetry."""
        return refused(self.defects, self._mapping)

    def add(self, topic: str, message: Any, sent_ns: int, received_ns: int) -> None:
        """Take a message; arguments as of ``Collector.add``."""
        self._collector.add(topic, message, sent_ns, received_ns)

    def advance(self) -> list[Telemetry]:
        """Return the telemetry that has become complete, in blocks.

        Raises
        ------
        ValueError
            When the rate of the samples is no possible sample rate.
        """
        for topic, series in self._collector.take().items():
            self._waiting[topic] = _joined(self._waiting.get(topic), series)
        own = self._waiting[self._mapping.position.topic]
        if len(own) > _MOST_WAITING:
            own = self._waiting[self._mapping.position.topic] = _part(own, -_MOST_WAITING, None)
        if self.rate is None and not self._learn(own):
            return []
        return self._emit(self._new_stamps(own))

    def _learn(self, own: Series) -> bool:
        """Find the rate; return whether it is known now."""
        if len(own) < _LEAST_SAMPLES:
            return False
        span_s = 1e-9 * float(np.max(own.arrivals_ns) - np.min(own.arrivals_ns))
        if span_s < self._settings.learn_s:
            return False
        by_arrival = uses_arrival(own, self._mapping)
        times = own.arrivals_ns if by_arrival else stamped(own)[0]
        rate = find_rate(times, self._mapping.clock.rate_hz)
        if by_arrival:
            self._clock = ArrivalClock(rate.measured_period)
            rate = replace(rate, jitter=0.0)
        self.description = replace(
            self._given, sample_period=rate.period, acquisition=self._mapping.acquisition
        )
        self.rate = rate
        self._resampler = Resampler(rate)
        return True

    def _new_stamps(self, own: Series) -> NDArray[np.int64]:
        """Return the stamps of the samples that wait and are settled."""
        fresh = _part(own, self._stamped, None)
        self._stamped = len(own)
        if self._clock is not None:
            stamps = self._clock.push(fresh.arrivals_ns)
        else:
            stamps, filled = stamped(fresh) if len(fresh) else (fresh.stamps_ns, 0)
            self._filled += filled
        self._settled = np.concatenate([self._settled, stamps])
        return self._settled

    def _emit(self, stamps: NDArray[np.int64]) -> list[Telemetry]:
        assert self._resampler is not None
        assert self.description is not None
        assert self.rate is not None
        count = self._complete(len(stamps))
        if not count:
            return []
        stamps = stamps[:count]
        raw = join_topics(self._waiting, self._mapping, stamps)
        self._forget(count, int(stamps[count - 1]))
        columns = convert(raw, self._mapping, self.description)
        filled = tuple(name for name in COLUMNS if len(columns[name]))
        self._keep(stamps, columns)
        runs = self._resampler.push(stamps, np.column_stack([columns[name] for name in filled]))
        if self.refused:
            self.withheld += sum(len(run.stamps_ns) for run in runs)
            return []
        h = self.rate.period
        size = max(1, round(self._settings.block_s / h))
        return [block for run in runs for block in blocks_of(run, filled, h, size)]

    def _complete(self, count: int) -> int:
        """Return how many samples have what the other topics sent before them."""
        own = self._waiting[self._mapping.position.topic]
        if not count or len(self._waiting) == 1:
            return count
        latest = min(
            int(series.arrivals_ns[-1]) if len(series) else -(2**62)
            for topic, series in self._waiting.items()
            if series is not own
        )
        # A command may be sent on change only: its topic is not waited for longer than that.
        waited = int(own.arrivals_ns[-1]) - round(self._settings.wait_s * 1e9)
        late = np.flatnonzero(own.arrivals_ns[:count] > max(latest, waited))
        return int(late[0]) if len(late) else count

    def _forget(self, count: int, until_ns: int) -> None:
        """Forget samples that were used; of the other topics the latest before stay."""
        primary = self._mapping.position.topic
        self._waiting[primary] = _part(self._waiting[primary], count, None)
        self._settled = self._settled[count:]
        self._stamped -= count
        for topic, series in self._waiting.items():
            if topic == primary or len(series) < 2:
                continue
            span_ns = round((self._settings.wait_s + 1.0) * 1e9)
            old = int(np.searchsorted(series.arrivals_ns, series.arrivals_ns[-1] - span_ns))
            self._waiting[topic] = _part(series, max(0, old - 2), None)

    def _keep(self, stamps: NDArray[np.int64], columns: dict[str, NDArray[np.float64]]) -> None:
        """Look for defects in the latest samples."""
        assert self.rate is not None
        assert self.description is not None
        kept, h = self._kept, self.rate.period
        kept.stamps.append(stamps)
        kept.columns.append(columns)
        kept.samples += len(stamps)
        kept.unchecked += len(stamps)
        while kept.samples - len(kept.stamps[0]) > _LOOK_BACK_S / h:
            kept.samples -= len(kept.stamps.pop(0))
            kept.columns.pop(0)
        if kept.unchecked * h < _CHECK_S:
            return
        kept.unchecked = 0
        times = np.concatenate(kept.stamps)
        whole = {name: np.concatenate([part[name] for part in kept.columns]) for name in COLUMNS}
        self.defects = [
            *stream_defects(self.losses, self.rebuilt),
            *find_defects(whole, times, self._mapping, self.description),
        ]


def _joined(before: Series | None, series: Series) -> Series:
    if before is None:
        return series
    if not len(series):
        return before
    return Series(
        np.concatenate([before.stamps_ns, series.stamps_ns]),
        np.concatenate([before.arrivals_ns, series.arrivals_ns]),
        {key: np.concatenate([before.values[key], new]) for key, new in series.values.items()},
    )


def _part(series: Series, start: int, stop: int | None) -> Series:
    return Series(
        series.stamps_ns[start:stop],
        series.arrivals_ns[start:stop],
        {key: values[start:stop] for key, values in series.values.items()},
    )
