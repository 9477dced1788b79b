# SPDX-License-Identifier: Apache-2.0
"""Extraction of records, which are seconds to minutes of motion of an unknown drive.

Records are delimited by the position, because the drive may have no position command.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry, lost_between
from ema_monitor.reasons import PieceTooShort, Reason, TooManySamples, TravelTooSmall
from ema_monitor.windows.blocks import BlockStamp, LatestBlocks
from ema_monitor.windows.rest import PositionBin, PositionBins, SteadyRun
from ema_monitor.windows.trigger import (
    Defect,
    Refusal,
    TriggerSettings,
    WindowTrigger,
    break_between,
    not_finite,
    rate_defect,
)
from ema_monitor.windows.window import MIN_TRAVEL, Window

LEAST_MOTION_S: Final = 2.0
"""Shortest total motion in a record [s]."""

_RECENT_S: Final = 5.0
"""Duration of the latest telemetry whose travel determines the threshold of rest [s]."""

MARGIN_S: Final = 0.5
"""Rest included before and after the motion of a record [s]."""

MOST_RECORD_SAMPLES: Final = 200_000
"""Largest number of samples in a record: 6.4 MB in four columns."""

LONGEST_REST_S: Final = 5.0
"""Longest rest that a record includes in full [s]; of longer rests, it only keeps the margins."""

_REST_S: Final = 0.25
_LEAST_REST_SAMPLES: Final = 3
_RESTING_SHARE: Final = 2e-3
_LEAST_TRAVEL_IN_THRESHOLDS: Final = 3.0
_REMAINDER: Final = 0.25
_STILL_SHARE: Final = 0.01
_RATIO_OF_MOTION: Final = 1.0


def stands_still(telemetry: Telemetry) -> bool:
    """Return whether the position stands still while the command moves.

    The position stands still if it travels less than 1 % of the command's travel. Without a
    command, the result is False. White noise of the command does not count as motion: the mean
    square of its differences is twice its variance (von Neumann's ratio).
    """
    if not telemetry.has_command:
        return False
    command = telemetry.command
    travel = float(np.ptp(command))
    if travel < MIN_TRAVEL or float(np.ptp(telemetry.position)) >= _STILL_SHARE * travel:
        return False
    return float(np.mean(np.diff(command) ** 2)) < _RATIO_OF_MOTION * float(np.var(command))


class _Step(NamedTuple):
    """A position bin and the state of motion at its end."""

    item: PositionBin
    rest_begin: int
    is_resting: bool
    is_moving: bool


class _Cut(NamedTuple):
    """Last sample of a record, number of samples in motion before it, and steps after it."""

    end: int
    moved: int
    later: list[_Step]


class RecordTrigger(WindowTrigger):
    """Extracts records from continuous telemetry, based on the position.

    The position is at rest if it stays within a threshold for 0.25 s. The threshold is derived from
    the resolution and noise of the sensor (`PositionBins`). It is at least 0.2 % of the travel in
    the latest 5 s.

    A record begins with a motion, and includes up to 0.5 s of the preceding rest. It ends

    - at the first rest after ``record_s``, unless it ends for another reason within a quarter of
      ``record_s`` after this rest: a short remainder is part of the record,
    - when the position has rested for ``record_rest_s``, or for 5 s in which the command moves; the
      record includes 0.5 s of the rest,
    - at the end or a break of the telemetry; gaps of at most 1 s are interpolated,
    - after twice ``record_s``, even in motion.

    Rests of more than 5 s within a record are left out, except 0.5 s at both ends, and do not count
    towards its length. Thus a record of a joint that often pauses has as much motion as any other.

    The next record begins at least ``record_interval_s`` after the start of the previous record;
    the motion between them is not stored.

    ``record_s`` is limited to half of ``MOST_RECORD_SAMPLES`` samples. Pieces with less than 2 s of
    motion, or with too little travel, are skipped.

    A standstill under a moving command is a record as well. It begins with the motion of the
    command, and includes up to 0.5 s before it. It ends after ``record_s``, or at the end of the
    telemetry.

    Parameters are as in `WindowTrigger`.

    Attributes
    ----------
    shortfall
        Reason why the longest skipped motion is not a record; None if none was skipped.
    interpolated
        Number of lost samples that were interpolated.
    """

    def __init__(
        self, parameters: ActuatorParameters, settings: TriggerSettings | None = None
    ) -> None:
        self.shortfall: Reason | None = None
        self.interpolated = 0
        super().__init__(parameters, settings)

    def reset(self) -> None:
        """Discard the telemetry so far; the counts remain."""
        super().reset()
        self._latest = LatestBlocks()
        self._bins: PositionBins | None = None
        self._run, self._recent = SteadyRun(0), SteadyRun(0)
        self._piece_begin = self._free_from = 0
        self._motion_begin: int | None = None
        # Ranges of running indices that the open record leaves out.
        self._omitted: list[range] = []
        self._rest_begin: int | None = None
        self._omit_from = 0
        # Index before which samples of the latest rest are not in memory.
        self._dropped = 0
        self._still_begin: int | None = None
        self._cut_at: _Cut | None = None
        self._moved = self._not_before = 0
        # Index after the latest record of full length; None before the first.
        self._full_end: int | None = None
        self._threshold = 0.0

    @property
    def kept_samples(self) -> int:
        """Number of samples in memory."""
        return self._latest.samples

    @property
    def oldest_index(self) -> int:
        """Running index of the earliest sample in memory; 0 without samples."""
        return self._latest.begin if self._latest.samples else 0

    def feed(self, block: Telemetry) -> list[Window | Refusal | Defect]:
        """Process the next block; return the completed records, refusals and defects."""
        events = self.split(block)
        if cause := not_finite(block) or self._too_many(block):
            return [*events, *self.end_piece(block.stamp_ns, cause)]
        if self._bins is None:
            begin = self._piece_begin = self._free_from = self._dropped = block.first_index
            self._bins = PositionBins(block.sample_period, begin)
            self._run, self._recent = SteadyRun(begin), SteadyRun(begin)
        return events + self._process(block)

    def _process(self, block: Telemetry) -> list[Window | Refusal | Defect]:
        """Process the next samples; return the completed records."""
        assert self._bins is not None
        self._latest.add(block)
        bins = self._bins.add(block.position, block.interpolated)
        if not bins:
            return []
        h = block.sample_period
        events: list[Window | Refusal | Defect] = [*self._follow(bins, h)]
        events += self._stand_still(self._full(h))
        self._forget()
        return events

    def split(self, block: Telemetry) -> list[Window | Refusal | Defect]:
        """End the current piece of telemetry if a block does not continue it; return the events."""
        last = self._latest.last
        if last is None or not (cause := break_between(last, block)):
            return []
        lost = None if not_finite(block) else lost_between(last, block)
        if lost is None:
            return self.end_piece(block.stamp_ns, cause)
        self.interpolated += len(lost)
        return self._process(lost)

    def end_piece(self, stamp_ns: int, cause: Reason) -> list[Window | Refusal | Defect]:
        """End the current piece of telemetry at a timestamp [ns]; return the completed events."""
        events: list[Window | Refusal | Defect] = [*self.finish(), Defect(stamp_ns, cause)]
        self.reset()
        return events

    def finish(self) -> Sequence[Window | Refusal]:
        """End the telemetry; return the completed record, if there is one."""
        last, bins = self._latest.last, self._bins
        if last is None or bins is None:
            return []
        events = self._follow(bins.finish(), last.sample_period)
        # After a record of full length, the next record may begin after the last sample.
        if self._start is not None and self._start < self._latest.end:
            end = self._latest.end - 1
            moved = self._moved_until(end)
            if self._motion_begin is None:
                end = min(end, self._run.begin + round(MARGIN_S / last.sample_period))
            events += self._close(end, moved)
        else:
            events += self._stand_still(round(LEAST_MOTION_S / last.sample_period))
        self.reset()
        return events

    def _too_many(self, block: Telemetry) -> Reason | None:
        """Return the reason why the shortest record would have too many samples, or None."""
        needed = round(LEAST_MOTION_S / block.sample_period)
        if needed <= MOST_RECORD_SAMPLES // 2:
            return None
        most = MOST_RECORD_SAMPLES // 2
        return TooManySamples(block.sample_period, LEAST_MOTION_S, needed, most, is_record=True)

    def _follow(self, bins: Sequence[PositionBin], h: float) -> list[Window | Refusal]:
        """Process position bins; return the completed records. ``h`` is the sample period [s]."""
        rest_samples = max(_LEAST_REST_SAMPLES, round(_REST_S / h))
        longest = round(self.settings.record_rest_s / h) + rest_samples
        recent = round(_RECENT_S / h) + rest_samples
        events: list[Window | Refusal] = []
        for item in bins:
            self._threshold = item.threshold
            self._recent.add(item, math.inf, recent)
            threshold = max(item.threshold, _RESTING_SHARE * self._recent.travel)
            self._run.add(item, threshold, longest)
            begin = self._run.begin
            is_resting = item.last + 1 - begin >= rest_samples
            self.has_rested |= is_resting
            # Before the first motion of a piece it is unknown whether the position rests.
            is_moving = not is_resting and begin > self._piece_begin
            events += self._advance(_Step(item, begin, is_resting, is_moving), h)
        return events

    def _advance(self, step: _Step, h: float) -> list[Window | Refusal]:
        """Open or close a record at a step; return the completed records."""
        item, begin = step.item, step.rest_begin
        margin = round(MARGIN_S / h)
        if self._start is None:
            if step.is_moving and item.first >= self._not_before:
                start = max(self._free_from, self._not_before, item.first - margin)
                self._open(start, item, h)
            return []
        if step.is_moving and self._motion_begin is None:
            self._motion_begin = item.first
        elif step.is_resting and self._motion_begin is not None:
            self._moved += max(0, begin - self._motion_begin)
            self._motion_begin = None
        if step.is_resting and self._cut_at is None:
            rest = round(LONGEST_REST_S / h)
            if not self._omit_rest(step, margin, rest):
                return self._close(min(item.last, begin + margin), self._moved)
        length, bin_size = self._length(item.last + 1), item.last + 1 - item.first
        full = self._full(h)
        if step.is_resting and item.last + 1 - begin >= round(self.settings.record_rest_s / h):
            return self._close(min(item.last, begin + margin), self._moved)
        if length + bin_size > 2 * full:
            record = self._close(item.last, self._moved_until(item.last))
            if step.is_moving and item.last + 1 >= self._not_before:
                self._open(item.last + 1, item, h)
            return record
        cut = self._cut_at
        if cut is None:
            if step.is_resting and length >= full:
                self._cut_at = _Cut(min(item.last, begin + margin), self._moved, [])
            return []
        cut.later.append(step)
        if item.last - cut.end < _REMAINDER * full:
            return []
        events = self._close(cut.end, cut.moved)
        for later in cut.later:
            events += self._advance(later, h)
        return events

    def _omit_rest(self, step: _Step, margin: int, longest: int) -> bool:
        """Leave out the current rest, except its margins, if it is longer than ``longest``.

        Within a range that is left out, the position stays within the threshold. If the position
        creeps, the rest begins later, and the next range follows the previous range. Returns False
        if the command moves during the rest, which is a standstill.
        """
        if step.rest_begin != self._rest_begin:
            before = self._omitted[-1].stop if self._omitted else step.rest_begin
            self._rest_begin, self._omit_from = step.rest_begin, max(step.rest_begin, before)
        begin, item = self._omit_from, step.item
        if item.last + 1 - begin <= longest:
            return True
        if (item.last + 1 - begin) // longest > (item.first - begin) // longest:
            latest, _, _ = self._latest.cut(item.last + 1 - longest, item.last + 1)
            if stands_still(latest):
                return False
            self._dropped = item.first - margin
            self._latest.omit(range(begin + margin, self._dropped))
        if self._omitted and self._omitted[-1].start == begin + margin:
            self._omitted.pop()
        self._omitted.append(range(begin + margin, item.first - margin))
        return True

    def _length(self, end: int) -> int:
        """Return the number of samples of the open record that are kept, up to ``end``."""
        assert self._start is not None
        return end - self._start - sum(map(len, self._omitted))

    def _full(self, h: float) -> int:
        """Return the number of samples after which a rest ends a record."""
        return min(round(self.settings.record_s / h), MOST_RECORD_SAMPLES // 2)

    def _stand_still(self, least: int) -> list[Window | Refusal]:
        """Return the record of a standstill if it has at least ``least`` samples."""
        last, bins = self._latest.last, self._bins
        if self._start is not None or last is None or bins is None or not last.has_command:
            self._still_begin = None
            return []
        end, begin = bins.next_index, self._still_begin
        if begin is None:
            begin = max(self._free_from, self._latest.begin)
        if begin >= end:
            return []
        telemetry, first, latest = self._latest.cut(begin, end)
        self._still_begin = begin if stands_still(telemetry) else None
        if self._still_begin is None or len(telemetry) < least:
            return []
        self._free_from, self._still_begin = end, None
        return [self._checked(Window(telemetry), first, latest)]

    def _moved_until(self, end: int) -> int:
        """Return the number of samples in motion in the open record, up to the sample ``end``."""
        return self._moved + (0 if self._motion_begin is None else end + 1 - self._motion_begin)

    def _open(self, start: int, item: PositionBin, h: float) -> None:
        self._start, self._moved = start, 0
        self._omitted, self._rest_begin = [], None
        self._not_before = start + round(self.settings.record_interval_s / h)
        self._motion_begin = max(start, item.first)

    def _close(self, end: int, moved: int) -> list[Window | Refusal]:
        """End the open record at the sample ``end``; return the record unless it is skipped.

        ``moved`` is the number of its samples in motion.
        """
        start, self._start, self._motion_begin, self._cut_at = self._start, None, None, None
        if start is None:
            return []
        # The end of a rest that creeps may lie where an earlier part of the rest was left out.
        end = min([end, *(item.start - 1 for item in self._omitted if end in item)])
        self._free_from = max(end + 1, self._dropped)
        omitted = tuple(item for item in self._omitted if item.stop <= end)
        telemetry, first, last = self._latest.cut(start, end + 1, omitted)
        h = telemetry.sample_period
        is_short = len(telemetry) < self._full(h)
        rest = round(self.settings.record_rest_s / h)
        follows = self._full_end is not None and start - self._full_end <= rest
        if not is_short:
            self._full_end = end + 1
        moved_s = moved * h
        if shortfall := self._shortfall(moved_s, float(np.ptp(telemetry.position))):
            self.passed_over += 1
            if moved_s >= self.longest_motion_s:
                self.longest_motion_s, self.shortfall = moved_s, shortfall
            return []
        window = Window(telemetry, is_remainder=is_short and follows, omitted=omitted)
        return [self._checked(window, first, last)]

    @staticmethod
    def _checked(window: Window, first: BlockStamp, last: BlockStamp) -> Window | Refusal:
        """Return the record, or its refusal if timestamps contradict the sample period."""
        if cause := rate_defect(window.sample_period, first, last):
            return Refusal(window.start_ns, window.end_ns, cause)
        return window

    def _shortfall(self, moved_s: float, travel: float) -> Reason | None:
        """Return the reason why a piece with this motion and travel is not a record, or None."""
        if moved_s < LEAST_MOTION_S:
            return PieceTooShort(moved_s, LEAST_MOTION_S)
        least = max(MIN_TRAVEL, _LEAST_TRAVEL_IN_THRESHOLDS * self._threshold)
        return TravelTooSmall(travel, least) if travel < least else None

    def _forget(self) -> None:
        """Drop blocks before the earliest possible start of a record."""
        last, bins = self._latest.last, self._bins
        if last is None or bins is None:
            return
        oldest = self._still_begin if self._start is None else self._start
        if oldest is None:
            oldest = self._oldest_at_rest(bins, last.sample_period)
        self._latest.forget(oldest)

    def _oldest_at_rest(self, bins: PositionBins, h: float) -> int:
        """Return the earliest sample of a record that begins with the next bin."""
        return max(self._free_from, bins.next_index - round(MARGIN_S / h))
