# SPDX-License-Identifier: Apache-2.0
"""Import of telemetry from the samples of a file or bag."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.arrival import ArrivalClock
from ema_bags.inputs.conversion import convert, with_lead
from ema_bags.inputs.defects import (
    find_defects,
    not_finite,
    other_rate,
    renewed_slowly,
    stream_defects,
)
from ema_bags.inputs.held import renewed_rows
from ema_bags.inputs.impossible import ImpossibleSampleRepair
from ema_bags.inputs.input_defect import InputDefect
from ema_bags.inputs.limits import limits_of
from ema_bags.inputs.mapping import ColumnMapping
from ema_bags.inputs.ordering import sorting_order
from ema_bags.inputs.publishers import two_publishers
from ema_bags.inputs.rate import Rate, find_rate
from ema_bags.inputs.resampling import GaplessRun, Losses, Resampler
from ema_bags.inputs.series import Series, join_topics
from ema_bags.inputs.temperature import MeasuredRise, RiseSampler, held_from
from ema_bags.inputs.wrapping import Unwrapper
from ema_core.description import ActuatorDescription
from ema_core.telemetry import COLUMNS, PAUSE_S, SERIES, Telemetry

BLOCK_S: Final = 0.05
"""Default block length in imported bags [s]."""

_BLOCK_SAMPLES: Final = 20


class Converted(NamedTuple):
    """Converted samples and the gapless runs made from them."""

    stamps_ns: NDArray[np.int64]
    """Stamps of the samples, ``(n,)`` [ns]."""
    columns: dict[str, NDArray[np.float64]]
    """Columns in SI units before resampling, ``(n,)`` or empty."""
    runs: list[GaplessRun]
    """Resampled runs."""


class SampleStream:
    """Converts series to runs of telemetry, either a whole file or live data in parts.

    Parameters
    ----------
    description
        Actuator description; its sample period and acquisition are replaced by measured values.
    rate
        Sample rate.

    Attributes
    ----------
    rises
        Sampler of the measured temperature; None if not measured.
    """

    def __init__(
        self, mapping: ColumnMapping, description: ActuatorDescription, rate: Rate
    ) -> None:
        self.rises = RiseSampler(mapping.temperature) if mapping.temperature else None
        acquisition = mapping.acquisition
        self.description = replace(
            with_lead(description, mapping), sample_period=rate.period, acquisition=acquisition
        )
        self.filled = (
            *(name for name in COLUMNS if name not in acquisition.missing),
            *(["payload"] if mapping.payload else []),
        )
        self._mapping = mapping
        limits = limits_of(mapping, description, rate.period)
        self._impossible, self._unwrapper = (
            ImpossibleSampleRepair(mapping, limits),
            Unwrapper(mapping),
        )
        motion = tuple(
            self.filled.index(name) for name in ("command", "position") if name in self.filled
        )
        steady = {"payload"} if description.is_modelled else {"payload", "current"}
        nearest = tuple(i for i, name in enumerate(self.filled) if name in steady)
        self._resampler = Resampler(rate, mapping.fill_lost, motion, nearest)

    @property
    def losses(self) -> Losses:
        """Lost and irregular samples so far."""
        return self._resampler.losses

    def push(
        self, by_topic: Mapping[str, Series], stamps_ns: NDArray[np.int64], *, is_last: bool = False
    ) -> Converted:
        """Convert the next samples to SI units and gapless runs.

        The arguments match ``join_topics`` and ``Resampler.push``. Samples are held back if they
        cannot be judged without the next samples.
        """
        return self.push_joined(
            join_topics(by_topic, self._mapping, stamps_ns), stamps_ns, is_last=is_last
        )

    def push_joined(
        self,
        raw: Mapping[str, NDArray[np.float64]],
        stamps_ns: NDArray[np.int64],
        *,
        is_last: bool = False,
    ) -> Converted:
        """Convert samples already joined by ``join_topics``; otherwise like ``push``."""
        raw = dict(raw)
        temperature = raw.pop("temperature", None)
        if self.rises is not None and temperature is not None:
            self.rises.push(stamps_ns, temperature)
        stamps_ns, raw = self._impossible.push(stamps_ns, raw, is_last=is_last)
        raw = self._unwrapper.push(raw)
        self.losses.impossible = self._impossible.count
        self.losses.wraps = sum(item.count for item in self._unwrapper.wrapped.values())
        steps = np.diff(stamps_ns)
        breaks = 1 + np.flatnonzero((steps < 0) | (steps > PAUSE_S * 1e9))
        columns = convert(raw, self._mapping, self.description, breaks.tolist())
        values = np.column_stack([columns[name] for name in self.filled])
        return Converted(
            stamps_ns, columns, self._resampler.push(stamps_ns, values, is_last=is_last)
        )

    def blocks(self, run: GaplessRun, block_s: float, shift_ns: int = 0) -> Iterator[Telemetry]:
        """Yield the blocks of a run, of at most ``block_s`` each; unmeasured columns are empty.

        Stamps are shifted by ``shift_ns``.
        """
        h = self.description.sample_period
        size = max(1, round(block_s / h))
        for start in range(0, len(run.stamps_ns), size):
            part = run.values[start : start + size]
            columns = {name: np.ascontiguousarray(part[:, i]) for i, name in enumerate(self.filled)}
            yield Telemetry(
                int(run.stamps_ns[start]) + shift_ns,
                h,
                run.first_index + start,
                **{name: columns.get(name, np.empty(0)) for name in SERIES},
            )


@dataclass(frozen=True, eq=False)
class Imported:
    """Imported telemetry, with its rate and defects."""

    mapping: ColumnMapping
    """Mapping used for the import."""
    stream: SampleStream
    """Converter used for the import."""
    rate: Rate
    """Sample rate measured from the stamps."""
    columns: dict[str, NDArray[np.float64]]
    """Columns in SI units before resampling, ``(n,)`` or empty."""
    runs: list[GaplessRun]
    """Resampled runs, with columns in the order of ``stream.filled``."""
    rebuilt: int
    """Number of stamps reconstructed from arrival times."""
    defects: list[InputDefect]
    """Defects of the mapping and of the samples."""
    rises: list[MeasuredRise]
    """Measured temperature rises, at most one per second."""

    @property
    def description(self) -> ActuatorDescription:
        """Actuator description with the measured sample period and acquisition."""
        return self.stream.description

    def blocks(self, block_s: float = BLOCK_S) -> Iterator[Telemetry]:
        """Yield the telemetry in blocks of ``block_s``, or of 20 samples if these are longer.

        Blocks have at least 20 samples because each has a fixed cost. Stamps are shifted by
        ``shift_ns``.
        """
        block_s = max(block_s, _BLOCK_SAMPLES * self.description.sample_period)
        for run in self.runs:
            yield from self.stream.blocks(run, block_s, self.shift_ns)

    @property
    def shift_ns(self) -> int:
        """Shift that moves all stamps to 1970 or later [ns]; 0 if they are already."""
        first_s = min(int(run.stamps_ns[0]) for run in self.runs) // 1_000_000_000
        return -min(first_s, 0) * 1_000_000_000


def import_series(
    by_topic: Mapping[str, Series],
    mapping: ColumnMapping,
    description: ActuatorDescription,
    period: float | None = None,
) -> Imported:
    """Import the series of a file or bag as telemetry.

    Parameters
    ----------
    by_topic
        Series by topic; a table has the topic ``""``.
    description
        Actuator description; its sample period and acquisition are replaced by measured values.
    period
        Sample period of the telemetry [s]; None to keep the period of the samples.

    Raises
    ------
    ValueError
        If there are too few samples, or the sample period is out of range.
    """
    primary = by_topic[mapping.position.topic]
    if len(primary) < 2:
        source = f"topic {mapping.position.topic}" if mapping.position.topic else "the file"
        raise ValueError(f"{source} has {len(primary)} samples: expected at least 2")
    stamps, rebuilt = primary_stamps(primary, mapping)
    order = sorting_order(stamps)
    if order is not None:
        stamps, by_topic = stamps[order], {**by_topic, mapping.position.topic: primary[order]}
    rate = find_rate(stamps, mapping.clock.rate_hz)
    if rebuilt == len(primary):
        # Reconstructed stamps have no jitter; they only drift with the clock.
        rate = replace(rate, jitter=0.0)
    raw, notes = join_topics(by_topic, mapping, stamps), list(other_rate(rate, description))
    doubled = [] if rebuilt else list(two_publishers(stamps))
    if (rows := renewed_rows(raw)) is not None:
        times = len(stamps) / len(rows)
        rate = _renewed_rate(stamps[rows], times, mapping)
        raw, stamps = {name: values[rows] for name, values in raw.items()}, stamps[rows]
        notes = [renewed_slowly(rate, times)]
        # Values repeated by a second publisher are already dropped.
        doubled = [replace(defect, is_error=False) for defect in doubled]
    if period is not None:
        rate, notes = replace(rate, period=period), []
    stream = SampleStream(mapping, description, rate)
    if order is not None:
        stream.losses.reordered = int(np.count_nonzero(order != np.arange(len(order))))
    stamps, columns, runs = stream.push_joined(raw, stamps, is_last=True)
    if not runs:
        raise ValueError(
            f"none of the {stream.losses.samples} samples has finite values for all of "
            f"{', '.join(stream.filled)}"
        )
    updated_hz = None if rows is None else 1.0 / rate.period
    defects = [
        *notes,
        *doubled,
        *stream_defects(
            stream.losses,
            rebuilt,
            of_table=mapping.is_table,
            is_unknown=not description.is_modelled,
        ),
        *not_finite(columns),
        *find_defects(columns, stamps, mapping, stream.description, updated_hz),
        *(stream.rises.defects() if stream.rises else ()),
    ]
    first_ns = min(int(run.stamps_ns[0]) for run in runs)
    rises = held_from(first_ns, stream.rises.take()) if stream.rises else []
    return Imported(mapping, stream, rate, columns, runs, rebuilt, defects, rises)


def _renewed_rate(stamps_ns: NDArray[np.int64], times: float, mapping: ColumnMapping) -> Rate:
    """Return the rate at which values are updated, if each is published ``times`` times.

    ``stamps_ns`` are the stamps of the updates, ``(n,)``. A rate in the mapping is the rate of
    publication: it is divided by ``times``.
    """
    rate = find_rate(stamps_ns)
    if not mapping.clock.rate_hz:
        return rate
    return replace(rate, period=round(times) / mapping.clock.rate_hz)


def uses_arrival(series: Series, mapping: ColumnMapping) -> bool:
    """Return whether the samples of a topic are stamped by their arrival times."""
    return mapping.clock.source in ("sent", "arrival") or not series.is_stamped


def primary_stamps(primary: Series, mapping: ColumnMapping) -> tuple[NDArray[np.int64], int]:
    """Return the sample stamps [ns] and the number reconstructed from arrival times."""
    if mapping.is_table or not uses_arrival(primary, mapping):
        return primary.stamped()
    clock = ArrivalClock(find_rate(primary.arrivals_ns, mapping.clock.rate_hz).measured_period)
    stamps = np.concatenate([clock.push(primary.arrivals_ns), clock.flush()])
    return stamps, clock.rebuilt
