"""Telemetry from the samples of a file or bag."""

from collections.abc import Iterator
from collections.abc import Mapping as ByName
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
from ema_bags.inputs.impossible import ImpossibleSamples
from ema_bags.inputs.input_defect import InputDefect
from ema_bags.inputs.limits import limits_of
from ema_bags.inputs.mapping import Mapping
from ema_bags.inputs.ordering import sorting_order
from ema_bags.inputs.publishers import two_publishers
from ema_bags.inputs.rate import Rate, find_rate
from ema_bags.inputs.resampling import GaplessRun, Losses, Resampler
from ema_bags.inputs.series import Series, join_topics
from ema_bags.inputs.temperature import MeasuredRise, RiseSampler, held_from
from ema_bags.inputs.wrapping import Unwrapper
from ema_core.description import ActuatorDescription
from ema_core.telemetry import COLUMNS, PAUSE_S, Telemetry

BLOCK_S: Final = 0.05
"""Length of a block of telemetry in a bag [s]."""

_BLOCK_SAMPLES: Final = 20


class Converted(NamedTuple):
    """Samples in SI units."""

    stamps_ns: NDArray[np.int64]
    """Their stamps, ``(n,)`` [ns]."""
    columns: dict[str, NDArray[np.float64]]
    """Their columns before they are resampled, ``(n,)`` or empty."""
    runs: list[GaplessRun]
    """The runs that they make."""


class SampleStream:
    """Turns series into runs of telemetry: a file at once, live series part by part.

    Parameters
    ----------
    description
        Description of the actuator; its sample period and acquisition are replaced.
    rate
        Rate of the samples.

    Attributes
    ----------
    rises
        What samples the temperature; None where it is not measured.
    """

    def __init__(self, mapping: Mapping, description: ActuatorDescription, rate: Rate) -> None:
        self.rises = RiseSampler(mapping.temperature) if mapping.temperature else None
        acquisition = mapping.acquisition
        self.description = replace(
            with_lead(description, mapping), sample_period=rate.period, acquisition=acquisition
        )
        self.filled = tuple(name for name in COLUMNS if name not in acquisition.missing)
        self._mapping = mapping
        limits = limits_of(mapping, description, rate.period)
        self._impossible, self._unwrapper = ImpossibleSamples(mapping, limits), Unwrapper(mapping)
        motion = tuple(
            self.filled.index(name) for name in ("command", "position") if name in self.filled
        )
        is_unknown = description.drive == "unknown"
        nearest = tuple(i for i, name in enumerate(self.filled) if is_unknown and name == "current")
        self._resampler = Resampler(rate, mapping.fill_lost, motion, nearest)

    @property
    def losses(self) -> Losses:
        """Losses between the samples so far."""
        return self._resampler.losses

    def push(
        self, by_topic: ByName[str, Series], stamps_ns: NDArray[np.int64], *, is_last: bool = False
    ) -> Converted:
        """Return the next samples in SI units, and the runs that they make.

        Arguments are as in ``join_topics`` and ``Resampler.push``. Samples wait for the next ones
        if these show whether they are possible.
        """
        return self.push_joined(
            join_topics(by_topic, self._mapping, stamps_ns), stamps_ns, is_last=is_last
        )

    def push_joined(
        self,
        raw: ByName[str, NDArray[np.float64]],
        stamps_ns: NDArray[np.int64],
        *,
        is_last: bool = False,
    ) -> Converted:
        """Do as ``push`` with the result of ``join_topics`` for the stamps."""
        raw = dict(raw)
        temperature = raw.pop("temperature", None)
        if self.rises is not None and temperature is not None:
            self.rises.push(stamps_ns, temperature)
        stamps_ns, raw = self._impossible.push(stamps_ns, raw, is_last=is_last)
        raw = self._unwrapper.push(raw)
        self.losses.impossible = self._impossible.count
        self.losses.wraps = sum(self._unwrapper.wraps.values())
        steps = np.diff(stamps_ns)
        breaks = 1 + np.flatnonzero((steps < 0) | (steps > PAUSE_S * 1e9))
        columns = convert(raw, self._mapping, self.description, breaks.tolist())
        values = np.column_stack([columns[name] for name in self.filled])
        return Converted(
            stamps_ns, columns, self._resampler.push(stamps_ns, values, is_last=is_last)
        )

    def blocks(self, run: GaplessRun, block_s: float, shift_ns: int = 0) -> Iterator[Telemetry]:
        """Yield a run in blocks of a length at most; columns that are not measured are empty."""
        h = self.description.sample_period
        size = max(1, round(block_s / h))
        for start in range(0, len(run.stamps_ns), size):
            part = run.values[start : start + size]
            columns = {name: np.ascontiguousarray(part[:, i]) for i, name in enumerate(self.filled)}
            yield Telemetry(
                int(run.stamps_ns[start]) + shift_ns,
                h,
                run.first_index + start,
                **{name: columns.get(name, np.empty(0)) for name in COLUMNS},
            )


@dataclass(frozen=True, eq=False)
class Imported:
    """Telemetry that was imported.

    Attributes
    ----------
    mapping, stream
        What it was imported with.
    rate
        Rate of the samples as their stamps give it.
    columns
        The columns before they were resampled, in SI units, ``(n,)`` or empty.
    runs
        The columns after, in the order of ``stream.filled``.
    rebuilt
        How many stamps were rebuilt.
    defects
        Defects of the mapping and of the samples.
    rises
        Measured rises of the temperature, one a second at most.
    """

    mapping: Mapping
    stream: SampleStream
    rate: Rate
    columns: dict[str, NDArray[np.float64]]
    runs: list[GaplessRun]
    rebuilt: int
    defects: list[InputDefect]
    rises: list[MeasuredRise]

    @property
    def description(self) -> ActuatorDescription:
        """Description with the sample period and acquisition of the samples."""
        return self.stream.description

    def blocks(self, block_s: float = BLOCK_S) -> Iterator[Telemetry]:
        """Yield the telemetry in blocks of a length, or of 20 samples if these last longer.

        Each block costs as much to read as many samples. No stamp is before the epoch.
        """
        block_s = max(block_s, _BLOCK_SAMPLES * self.description.sample_period)
        for run in self.runs:
            yield from self.stream.blocks(run, block_s, self.shift_ns)

    @property
    def shift_ns(self) -> int:
        """Shift of the stamps after which none is before the epoch [ns]."""
        first_s = min(int(run.stamps_ns[0]) for run in self.runs) // 1_000_000_000
        return -min(first_s, 0) * 1_000_000_000


def import_series(
    by_topic: ByName[str, Series],
    mapping: Mapping,
    description: ActuatorDescription,
    period: float | None = None,
) -> Imported:
    """Return the telemetry in the series of a file or bag.

    Parameters
    ----------
    by_topic
        Series by topic; a table has the topic ``""``.
    description
        Description of the actuator; its sample period and acquisition are replaced by those found.
    period
        Sample period of the telemetry [s]; None: the period of the samples.

    Raises
    ------
    ValueError
        If there are too few samples, or their period is out of range.
    """
    primary = by_topic[mapping.position.topic]
    if len(primary) < 2:
        place = f"topic {mapping.position.topic}" if mapping.position.topic else "the file"
        raise ValueError(f"{place} has {len(primary)} samples: expected at least 2")
    stamps, rebuilt = primary_stamps(primary, mapping)
    order = sorting_order(stamps)
    if order is not None:
        stamps, by_topic = stamps[order], {**by_topic, mapping.position.topic: primary[order]}
    rate = find_rate(stamps, mapping.clock.rate_hz)
    if rebuilt == len(primary):
        # They are on a line, whose motion as it follows the clock is not jitter of the samples.
        rate = replace(rate, jitter=0.0)
    raw, notes = join_topics(by_topic, mapping, stamps), list(other_rate(rate, description))
    doubled = [] if rebuilt else list(two_publishers(stamps))
    if (rows := renewed_rows(raw)) is not None:
        times = len(stamps) / len(rows)
        rate = _renewed_rate(stamps[rows], times, mapping)
        raw, stamps = {name: values[rows] for name, values in raw.items()}, stamps[rows]
        notes = [renewed_slowly(rate, times)]
        # The values that the other publisher repeats are left out.
        doubled = [replace(defect, is_error=False) for defect in doubled]
    if period is not None:
        rate, notes = replace(rate, period=period), []
    stream = SampleStream(mapping, description, rate)
    if order is not None:
        stream.losses.reordered = int(np.count_nonzero(order != np.arange(len(order))))
    stamps, columns, runs = stream.push_joined(raw, stamps, is_last=True)
    if not runs:
        raise ValueError(
            f"none of {stream.losses.samples} samples has a finite value in all of "
            f"{', '.join(stream.filled)}"
        )
    defects = find_defects(columns, stamps, mapping, stream.description)
    if rows is not None:
        few = f"{1.0 / rate.period:.4g} Hz may be too few for this motion: have the source renew "
        few += "its values faster"
        defects = [
            replace(defect, remedy=few) if defect.name == "gear_ratio" else defect
            for defect in defects
        ]
    defects = [
        *notes,
        *doubled,
        *stream_defects(
            stream.losses,
            rebuilt,
            of_table=mapping.is_table,
            is_unknown=description.drive == "unknown",
        ),
        *not_finite(columns),
        *defects,
        *(stream.rises.defects() if stream.rises else ()),
    ]
    first_ns = min(int(run.stamps_ns[0]) for run in runs)
    rises = held_from(first_ns, stream.rises.take()) if stream.rises else []
    return Imported(mapping, stream, rate, columns, runs, rebuilt, defects, rises)


def _renewed_rate(stamps_ns: NDArray[np.int64], times: float, mapping: Mapping) -> Rate:
    """Return the rate of the samples at which values are renewed, each published some times."""
    rate = find_rate(stamps_ns)
    if not mapping.clock.rate_hz:
        return rate
    return replace(rate, period=round(times) / mapping.clock.rate_hz)


def uses_arrival(series: Series, mapping: Mapping) -> bool:
    """Return whether the samples of a topic have no stamps except their times of arrival."""
    return mapping.clock.source in ("sent", "arrival") or not series.is_stamped


def primary_stamps(primary: Series, mapping: Mapping) -> tuple[NDArray[np.int64], int]:
    """Return the stamps of samples, and how many were rebuilt."""
    if mapping.is_table or not uses_arrival(primary, mapping):
        return primary.stamped()
    clock = ArrivalClock(find_rate(primary.arrivals_ns, mapping.clock.rate_hz).measured_period)
    stamps = np.concatenate([clock.push(primary.arrivals_ns), clock.flush()])
    return stamps, clock.rebuilt
