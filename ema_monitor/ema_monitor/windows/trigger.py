# SPDX-License-Identifier: Apache-2.0
"""Extraction of test windows from a telemetry stream, and detection of stream defects.

Decisions only depend on running indices and timestamps, never on reception times, so that a replay
gives the same windows.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.commands import approach_travel
from ema_core.parameters import ActuatorParameters
from ema_core.quantity import Checked, quantity, text
from ema_core.telemetry import COLUMNS, Telemetry, join
from ema_monitor.reason_texts import text_of
from ema_monitor.reasons import (
    ColumnsChanged,
    IndexWentBack,
    PayloadChanged,
    PeriodChanged,
    Reason,
    SamplesLost,
    SamplesNotFinite,
    StampsOffPeriod,
    TelemetryEnded,
    TimeWentBack,
    TooManyBlocks,
    TooManySamples,
)
from ema_monitor.windows.blocks import BlockStamp
from ema_monitor.windows.plausibility import impossible_motion
from ema_monitor.windows.window import Window

LOOKBACK_S: Final = 10.0
"""Length of buffered telemetry before a window, which includes the approach [s]."""

MOST_SAMPLES: Final = 2_000_000
"""Largest number of buffered samples, for any sample period."""

MOST_BLOCKS: Final = 50_000
"""Largest number of buffered blocks, for any size of blocks."""

TEST_CYCLE: Final = "test_cycle"
"""Setting ``windows``: each window begins when the command leaves rest, and gives an estimate."""

ANY_MOTION: Final = "any_motion"
"""Setting ``windows``: stretches of ordinary motion are combined into estimates."""

LEAST_REST: Final = 2
"""Smallest number of equal samples in a rest, for any sample period."""

_LARGEST: Final = 1e30
_RATE_TOLERANCE: Final = 0.01


@dataclass(frozen=True)
class Refusal:
    """Refusal of a window that cannot be used."""

    start_ns: int
    """Timestamp of the first sample of the window [ns]."""
    end_ns: int
    """Timestamp of the last sample of the window [ns]."""
    cause: Reason
    """Reason why the window cannot be used."""
    is_dropped: bool = False
    """Whether the monitor dropped a usable window: its queue was full, or it was not active."""
    is_cut_off: bool = False
    """Whether the telemetry ended before the window was complete."""

    @property
    def reason(self) -> str:
        """The cause as a sentence."""
        return text_of(self.cause)


@dataclass(frozen=True)
class Defect:
    """Defect of the stream outside any window, at ``stamp_ns`` [ns]."""

    stamp_ns: int
    cause: Reason

    @property
    def reason(self) -> str:
        """The cause as a sentence."""
        return text_of(self.cause)


@dataclass(frozen=True)
class TriggerSettings(Checked):
    """Settings for the start and length of windows."""

    windows: str = text(
        TEST_CYCLE,
        "identified motion: the motion after a rest, or any motion, combined",
        (TEST_CYCLE, ANY_MOTION),
    )
    window_s: float = quantity(0.5, "s", 0.01, 100.0, "length of a window")
    rest_s: float = quantity(0.02, "s", 1e-4, 10.0, "time at rest of the command before a window")
    threshold: float = quantity(
        1e-6,
        "rad",
        1e-12,
        1.0,
        "smallest change of the command that counts as motion",
        shown=("threshold_urad", "urad", 1e6),
    )
    record_s: float = quantity(
        60.0,
        "s",
        2.0,
        600.0,
        "for an unknown drive: length after which a rest ends the record; the limit is twice it",
    )
    record_rest_s: float = quantity(
        5.0, "s", 0.5, 600.0, "for an unknown drive: rest that ends a record of any length"
    )
    record_interval_s: float = quantity(
        0.0,
        "s",
        0.0,
        86_400.0,
        "for an unknown drive: least time between the starts of two records; motion between them "
        "is skipped",
    )


class WindowTrigger:
    """Extracts windows from telemetry blocks.

    A window begins at the last sample before the command leaves its rest value. The window is
    discarded if the command comes to rest again before the window is full, or only moves in one
    direction. Therefore the slow approach of a test cycle gives no window.

    Parameters
    ----------
    parameters
        Nominal parameters of the actuator. They determine the travel of an approach after which the
        position of the motor in its play is known.
    settings
        Settings for the start and length of windows.

    Attributes
    ----------
    longest_motion_s
        Longest motion so far that gave no window [s].
    has_rested
        Whether the command has been at rest so far.
    short_motions
        Number of motions that ended before a window was full.
    passed_over
        Number of motions that were skipped because of too little travel.
    """

    def __init__(
        self, parameters: ActuatorParameters, settings: TriggerSettings | None = None
    ) -> None:
        self.settings = settings or TriggerSettings()
        self.longest_motion_s = 0.0
        self.has_rested = False
        self.short_motions = self.passed_over = 0
        self._parameters = parameters
        self._approach_travel = approach_travel(parameters)
        self.reset()

    def reset(self) -> None:
        """Discard the telemetry so far; the counts remain."""
        self._blocks: list[Telemetry] = []
        self._start: int | None = None
        self._rest_value = float("nan")
        self._rest_count = 0

    def feed(self, block: Telemetry) -> list[Window | Refusal | Defect]:
        """Process the next block; return the completed windows, refusals and defects."""
        events = self.split(block)
        if cause := not_finite(block) or self._too_many(block):
            events.append(self.interrupt(block.stamp_ns, cause))
            return events
        self._blocks.append(block)
        events += self._scan(block)
        self._forget()
        return events

    def split(self, block: Telemetry) -> list[Window | Refusal | Defect]:
        """End the current piece of telemetry if a block does not continue it; return the events."""
        if self._blocks and (cause := break_between(self._blocks[-1], block)):
            return self.end_piece(block.stamp_ns, cause)
        return []

    def end_piece(self, stamp_ns: int, cause: Reason) -> list[Window | Refusal | Defect]:
        """End the current piece of telemetry at a timestamp [ns]; return the completed events."""
        return [self.interrupt(stamp_ns, cause)]

    def _too_many(self, block: Telemetry) -> Reason | None:
        """Return the reason why a window would exceed the memory limits, or None."""
        samples = round(self.settings.window_s / block.sample_period)
        if samples > MOST_SAMPLES // 2:
            return TooManySamples(
                block.sample_period,
                self.settings.window_s,
                samples,
                MOST_SAMPLES // 2,
                is_record=False,
            )
        if len(self._blocks) >= MOST_BLOCKS and self._is_needed(self._blocks[0]):
            return TooManyBlocks(MOST_BLOCKS)
        return None

    def finish(self) -> Sequence[Window | Refusal]:
        """End the telemetry; return the refusal of an incomplete window, if there is one."""
        if self._start is None:
            return []
        first, last = self._blocks_from(self._start)[0], self._blocks[-1]
        start_ns = first.stamp_at(self._start - first.first_index)
        end_ns = last.stamp_at(len(last) - 1)
        cause = TelemetryEnded((end_ns - start_ns) * 1e-9, self.settings.window_s)
        return [Refusal(start_ns, end_ns, cause, is_cut_off=True)]

    def interrupt(self, stamp_ns: int, cause: Reason) -> Refusal | Defect:
        """Drop the buffered blocks after an interruption of the stream at a timestamp [ns].

        Returns the refusal of the open window, or a defect if no window is open.
        """
        refused = [Refusal(cut.start_ns, cut.end_ns, cause) for cut in self.finish()]
        self.reset()
        return refused[0] if refused else Defect(stamp_ns, cause)

    def _scan(self, block: Telemetry) -> list[Window | Refusal | Defect]:
        """Process the commands of a block; return the windows and refusals that it completes."""
        h = block.sample_period
        rest_samples = max(LEAST_REST, round(self.settings.rest_s / h))
        window_samples = max(1, round(self.settings.window_s / h))
        threshold = self.settings.threshold
        events: list[Window | Refusal | Defect] = []
        for index, command in enumerate(block.command.tolist(), block.first_index):
            if abs(command - self._rest_value) <= threshold:
                self._rest_count += 1
                if self._rest_count == rest_samples:
                    self.has_rested = True
                    # The first value of the rest may be the last step of the motion.
                    self._rest_value = command
                if self._start is not None and self._rest_count >= rest_samples:
                    moved_s = (index - self._rest_count + 1 - self._start) * h
                    self.longest_motion_s = max(self.longest_motion_s, moved_s)
                    self.short_motions += 1
                    self._start = None
            else:
                if self._rest_count >= rest_samples:
                    self._start = index - 1
                self._rest_value, self._rest_count = command, 1
            if self._start is not None and index == self._start + window_samples:
                events += self._complete(self._start, window_samples)
                self._start = None
        return events

    def _complete(self, start: int, samples: int) -> list[Window | Refusal]:
        telemetry, refused = self._cut(start, samples)
        if is_one_way(telemetry.command, self.settings.threshold):
            self.longest_motion_s = max(self.longest_motion_s, samples * telemetry.sample_period)
            return []
        if refused:
            return [refused]
        commands = np.concatenate([block.command for block in self._blocks])
        approach = commands[: start - self._blocks[0].first_index + 1]
        play = play_after(approach, self._approach_travel, self.settings.threshold)
        return [Window(telemetry, play)]

    def _cut(self, start: int, samples: int) -> tuple[Telemetry, Refusal | None]:
        """Return the telemetry of a window, and its refusal if stamps or samples are wrong."""
        # Timestamps are counted from the block in which the window begins. Counted from the
        # approach, they would include the drift of the clock.
        held = self._blocks_from(start)
        offset = start - held[0].first_index
        telemetry = join(held).part(offset, offset + samples + 1)
        inside = [
            BlockStamp(block.first_index, block.stamp_ns)
            for block in held
            if start <= block.first_index <= start + samples
        ]
        if inside and (cause := rate_defect(telemetry.sample_period, inside[0], inside[-1])):
            return telemetry, Refusal(telemetry.stamp_ns, telemetry.stamp_at(samples), cause)
        if cause := impossible_motion(telemetry, self._parameters):
            return telemetry, Refusal(telemetry.stamp_ns, telemetry.stamp_at(samples), cause)
        return telemetry, None

    def _blocks_from(self, index: int) -> list[Telemetry]:
        """Return the buffered blocks, beginning with the block that contains a sample."""
        return [block for block in self._blocks if block.first_index + len(block) > index]

    def _forget(self) -> None:
        """Drop blocks that no window needs."""
        last = self._blocks[-1]
        kept = min(round(LOOKBACK_S / last.sample_period), MOST_SAMPLES // 2)
        oldest = (last.first_index if self._start is None else self._start) - kept
        count = 0
        while self._blocks[count].first_index + len(self._blocks[count]) < oldest:
            count += 1
        excess = len(self._blocks) - MOST_BLOCKS
        while count < excess and not self._is_needed(self._blocks[count]):
            count += 1
        del self._blocks[:count]

    def _is_needed(self, block: Telemetry) -> bool:
        return self._start is not None and block.first_index + len(block) > self._start


def play_after(command: NDArray[np.float64], travel: float, tolerance: float) -> float | None:
    """Return the position of the motor in its play after a command: 1, -1, or None if unknown.

    The position is known if the command, ``(n,)`` [rad], has last moved by ``travel`` in one
    direction, with reversals of at most ``tolerance``, which do not move the motor.
    """
    for direction in (1.0, -1.0):
        directed = direction * command
        far = np.flatnonzero(directed <= directed[-1] - travel)
        if far.size and _largest_fall(directed[far[-1] :]) <= tolerance:
            return direction
    return None


def is_one_way(command: NDArray[np.float64], tolerance: float) -> bool:
    """Return whether the reversals of a command, ``(n,)``, are within a tolerance [rad].

    Some faults only have an effect if the motion reverses.
    """
    return min(_largest_fall(command), _largest_fall(-command)) <= tolerance


def _largest_fall(command: NDArray[np.float64]) -> float:
    """Return the largest fall of a command below its maximum so far [rad]."""
    return float(np.max(np.maximum.accumulate(command) - command))


def rate_defect(
    sample_period: float, first: BlockStamp, last: BlockStamp
) -> StampsOffPeriod | None:
    """Return the reason why the stamps of two blocks contradict the sample period [s], or None."""
    if last.first_index <= first.first_index:
        return None
    period = (last.stamp_ns - first.stamp_ns) * 1e-9 / (last.first_index - first.first_index)
    if abs(period / sample_period - 1.0) <= _RATE_TOLERANCE:
        return None
    return StampsOffPeriod(period, sample_period)


def break_between(last: Telemetry, block: Telemetry) -> Reason | None:
    """Return the discontinuity between two successive blocks, or None."""
    if abs(block.sample_period / last.sample_period - 1.0) > 1e-6:
        return PeriodChanged(last.sample_period, block.sample_period)
    if block.missing != last.missing:
        return ColumnsChanged(tuple(block.missing), tuple(last.missing), block.first_index)
    if block.has_payload != last.has_payload:
        return PayloadChanged(block.has_payload, block.first_index)
    expected = last.first_index + len(last)
    if block.first_index > expected:
        return SamplesLost(expected, block.first_index)
    if block.first_index < expected:
        return IndexWentBack(expected - 1, block.first_index)
    if block.stamp_ns <= last.stamp_ns:
        return TimeWentBack((last.stamp_ns - block.stamp_ns) * 1e-9, block.first_index)
    return None


def not_finite(block: Telemetry) -> SamplesNotFinite | None:
    """Return the defect of the first column with unusable samples, or None.

    Samples are unusable if they are not finite, or too large for computation.
    """
    columns = [getattr(block, name) for name in COLUMNS]
    if np.maximum.reduce(np.abs(np.concatenate(columns))) < _LARGEST:
        return None
    for name, column in zip(COLUMNS, columns, strict=True):
        bad = np.flatnonzero(~(np.abs(column) < _LARGEST))
        if bad.size:
            first = int(bad[0])
            largest = _LARGEST if np.all(np.isfinite(column[bad])) else math.nan
            value, index = float(column[first]), block.first_index + first
            return SamplesNotFinite(name, value, index, int(bad.size), largest)
    return None
