"""Telemetry from the samples of a file or bag."""

from collections.abc import Iterator
from collections.abc import Mapping as ByTopic
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.arrival import ArrivalClock
from ema_bags.inputs.conversion import convert
from ema_bags.inputs.defects import InputDefect, find_defects, stream_defects
from ema_bags.inputs.joining import join_topics, stamped, uses_arrival
from ema_bags.inputs.mapping import Mapping
from ema_bags.inputs.rate import Rate, find_rate
from ema_bags.inputs.resampling import GaplessRun, Losses, Resampler
from ema_bags.inputs.series import Series
from ema_core.description import ActuatorDescription
from ema_core.telemetry import COLUMNS, Telemetry

_BLOCK_S: Final = 0.05


@dataclass(frozen=True, eq=False)
class Imported:
    """Telemetry that was imported.

    Attributes
    ----------
    mapping, description
        What it was imported with; the description has its sample period and acquisition.
    rate
        Rate of the samples as their stamps give it.
    columns
        The columns before they were resampled, in SI units, ``(n,)`` or empty.
    runs
        The columns after, in the order of ``filled``.
    filled
        Names of the columns that are measured.
    losses, rebuilt
        What was missing, and how many stamps were rebuilt.
    defects
        What is wrong.
    shift_ns
        What was added to the stamps, as a recording has none before the epoch [ns].
    """

    mapping: Mapping
    description: ActuatorDescription
    rate: Rate
    columns: dict[str, NDArray[np.float64]]
    runs: list[GaplessRun]
    filled: tuple[str, ...]
    losses: Losses
    rebuilt: int
    defects: list[InputDefect]
    shift_ns: int

    def blocks(self) -> Iterator[Telemetry]:
        """Yield the telemetry in blocks of 50 ms at most."""
        h = self.description.sample_period
        for run in self.runs:
            yield from blocks_of(run, self.filled, h, max(1, round(_BLOCK_S / h)), self.shift_ns)


def import_series(
    by_topic: ByTopic[str, Series], mapping: Mapping, description: ActuatorDescription
) -> Imported:
    """Return the telemetry in the series of a file or bag.

    Parameters
    ----------
    by_topic
        Series by topic; of a table that of the topic ``""``.
    description
        Description of the actuator; its sample period and acquisition are replaced by those found.

    Raises
    ------
    ValueError
        When there are too few samples, or their period is out of range.
    """
    own = by_topic[mapping.position.topic]
    if len(own) < 2:
        place = f"topic {mapping.position.topic}" if mapping.position.topic else "the file"
        raise ValueError(f"{place} has {len(own)} samples: expected at least 2")
    stamps, rebuilt = primary_stamps(own, mapping)
    rate = find_rate(stamps, mapping.clock.rate_hz)
    if rebuilt == len(own):
        # They are on a line: what it moves as it follows the clock is no jitter of the samples.
        rate = replace(rate, jitter=0.0)
    described = replace(description, sample_period=rate.period, acquisition=mapping.acquisition)
    columns = convert(join_topics(by_topic, mapping, stamps), mapping, described)
    filled = tuple(name for name in COLUMNS if len(columns[name]))
    resampler = Resampler(rate)
    runs = resampler.push(stamps, np.column_stack([columns[name] for name in filled]))
    losses = resampler.losses
    if not runs:
        raise ValueError(
            f"none of {losses.samples} samples has a finite value in all of {', '.join(filled)}"
        )
    defects = [
        *stream_defects(losses, rebuilt, of_table=mapping.is_table),
        *find_defects(columns, stamps, mapping, described),
    ]
    first_ns = min(int(run.stamps_ns[0]) for run in runs)
    shift_ns = -(first_ns // 1_000_000_000) * 1_000_000_000 if first_ns < 0 else 0
    return Imported(
        mapping, described, rate, columns, runs, filled, losses, rebuilt, defects, shift_ns
    )


def blocks_of(
    run: GaplessRun, filled: tuple[str, ...], sample_period: float, size: int, shift_ns: int = 0
) -> Iterator[Telemetry]:
    """Yield a run in blocks; columns that are not measured are empty.

    Parameters
    ----------
    filled
        Names of the columns of the run.
    sample_period
        Period [s].
    size
        Samples of a block at most.
    shift_ns
        Added to the stamps [ns].
    """
    for start in range(0, len(run.stamps_ns), size):
        part = run.values[start : start + size]
        given = {name: np.ascontiguousarray(part[:, i]) for i, name in enumerate(filled)}
        yield Telemetry(
            int(run.stamps_ns[start]) + shift_ns,
            sample_period,
            run.first_index + start,
            **{name: given.get(name, np.empty(0)) for name in COLUMNS},
        )


def primary_stamps(own: Series, mapping: Mapping) -> tuple[NDArray[np.int64], int]:
    """Return the stamps of samples, and how many were rebuilt."""
    if mapping.is_table or not uses_arrival(own, mapping):
        return stamped(own)
    clock = ArrivalClock(find_rate(own.arrivals_ns, mapping.clock.rate_hz).measured_period)
    stamps = np.concatenate([clock.push(own.arrivals_ns), clock.flush()])
    return stamps, clock.rebuilt
