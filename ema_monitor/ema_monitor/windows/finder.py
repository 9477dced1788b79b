# SPDX-License-Identifier: Apache-2.0
"""Search for windows in the telemetry of one actuator.

Live telemetry, replays and bags yield the same windows, because nothing depends on reception times.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from ema_core.description import ActuatorDescription
from ema_core.expecting import require_type
from ema_core.telemetry import Telemetry, lost_between
from ema_monitor.reasons import (
    CommandMissing,
    CommandTravelTooSmall,
    DescriptionChanged,
    MalformedBlock,
    MotionTooShort,
    NeverAtRest,
    OtherPeriod,
    Reason,
    RunTooShort,
)
from ema_monitor.windows.records import LEAST_MOTION_S, MOST_RECORD_SAMPLES, RecordTrigger
from ema_monitor.windows.stretches import StretchTrigger
from ema_monitor.windows.trigger import (
    ANY_MOTION,
    LOOKBACK_S,
    MOST_BLOCKS,
    MOST_SAMPLES,
    Defect,
    Refusal,
    TriggerSettings,
    WindowTrigger,
)
from ema_monitor.windows.window import MIN_TRAVEL, Window

_MANY_MOTIONS: Final = 3
_LONGEST_WINDOW_S: Final = 100.0


@dataclass(frozen=True)
class Segment:
    """A window or its refusal, together with its number and description."""

    number: int
    """Running number, from 0."""
    description: ActuatorDescription
    """Description of the actuator at the time of the window."""
    window: Window | Refusal
    """The window, or its refusal."""
    is_stretch: bool = False
    """Whether the window is a stretch of ordinary motion, to be combined with other stretches."""


class WindowFinder:
    """Finds the windows in the telemetry of one actuator.

    If the drive is unknown, the windows are records (`RecordTrigger`), regardless of the settings.
    Until the description is received, the latest ten seconds of telemetry are kept.

    Parameters
    ----------
    settings
        Settings for the start and length of windows.
    description
        Actuator description; None if not received yet.

    Raises
    ------
    ValueError
        If an argument has a wrong type.

    Attributes
    ----------
    description
        Latest description of the actuator; None before the first description.
    blocks
        Number of blocks received so far.
    lost_samples
        Number of samples missing between blocks.
    windows
        Number of windows so far, including refused windows.
    """

    def __init__(
        self, settings: TriggerSettings, description: ActuatorDescription | None = None
    ) -> None:
        require_type("settings", settings, TriggerSettings)
        self.description: ActuatorDescription | None = None
        self.blocks = self.lost_samples = self.windows = 0
        self._settings = settings
        self._undescribed: deque[Telemetry | Defect] = deque()
        self._trigger: WindowTrigger | None = None
        self._last: Telemetry | None = None
        self._sample_period: float | None = None
        self._lacks_command = False
        self._period_reported = False
        # Number of windows before the latest settings were applied; samples and longest gapless run
        # since then.
        self._windows_before = self._samples = self._run = self._longest_run = 0
        if description is not None:
            self.describe(description)

    @property
    def finds_records(self) -> bool:
        """Whether the windows are records, because the drive is unknown."""
        return isinstance(self._trigger, RecordTrigger)

    @property
    def window_s(self) -> float:
        """Length of a window [s]; for records, the shortest length.

        Before the description is received, it is the largest possible length, 100 s.
        """
        if self.finds_records:
            return LEAST_MOTION_S
        return self._trigger.settings.window_s if self._trigger else _LONGEST_WINDOW_S

    @property
    def longest_s(self) -> float:
        """Largest length of a window [s]."""
        if self._trigger is not None and not self.finds_records:
            return self.window_s
        period = self._sample_period
        if period is None and self.description is not None:
            period = self.description.sample_period
        longest_s = 2.0 * self._settings.record_s
        if period is not None:
            longest_s = min(longest_s, MOST_RECORD_SAMPLES * period)
        return longest_s if self.finds_records else max(longest_s, self.window_s)

    def oldest_index(self, block: Telemetry) -> int:
        """Return the running index of the earliest sample of a window that ``block`` may complete.

        For records, it is the earliest sample in memory.

        Parameters
        ----------
        block
            The next block.
        """
        if isinstance(self._trigger, RecordTrigger):
            return self._trigger.oldest_index
        return block.first_index - round(self.longest_s / block.sample_period) - 1

    @property
    def longest_motion_s(self) -> float:
        """Longest motion so far that gave no window [s]."""
        return self._trigger.longest_motion_s if self._trigger else 0.0

    @property
    def passed_over(self) -> int:
        """Number of motions that were skipped because they were too short in travel or time."""
        return self._trigger.passed_over if self._trigger else 0

    @property
    def shortfall(self) -> Reason | None:
        """Reason why the longest skipped motion is not a record.

        None if no motion was skipped, or if the windows are not records.
        """
        return self._trigger.shortfall if isinstance(self._trigger, RecordTrigger) else None

    @property
    def interpolated_samples(self) -> int:
        """Number of lost samples that were interpolated in records."""
        return self._trigger.interpolated if isinstance(self._trigger, RecordTrigger) else 0

    @property
    def has_rested(self) -> bool:
        """Whether the command has been at rest so far; for records, the position."""
        return self._trigger is not None and self._trigger.has_rested

    @property
    def shortage(self) -> Reason | None:
        """Reason why no complete window has been possible so far; None if one has been."""
        period = self._sample_period
        if period is None:
            return None
        if self._trigger is not None and not self.finds_records and self._lacks_command:
            return CommandMissing()
        window_s, longest = self.window_s, self._longest_run
        samples = round(window_s / period)
        if longest > samples:
            return None
        return RunTooShort(
            period, window_s, samples, longest, self.lost_samples, is_record=self.finds_records
        )

    @property
    def obstacle(self) -> Reason | None:
        """Reason why there has been no window since the settings were applied.

        The reason names a setting with its value, or a lack of telemetry or motion. None if there
        was a window, or if the reason is unknown.
        """
        trigger, settings = self._trigger, self._settings
        if trigger is None or self._sample_period is None or self.windows > self._windows_before:
            return None
        seen_s = self._samples * self._sample_period
        if seen_s > self.window_s and (shortage := self.shortage):
            return shortage
        if self.finds_records:
            return self.shortfall if trigger.passed_over >= _MANY_MOTIONS else None
        if trigger.passed_over >= _MANY_MOTIONS:
            return CommandTravelTooSmall(self.window_s, MIN_TRAVEL)
        if trigger.short_motions >= _MANY_MOTIONS and trigger.longest_motion_s < settings.window_s:
            return MotionTooShort(settings.window_s, settings.rest_s, trigger.longest_motion_s)
        if settings.windows != ANY_MOTION and not trigger.has_rested and seen_s > LOOKBACK_S:
            return NeverAtRest(settings.rest_s, settings.threshold, seen_s)
        return None

    def describe(self, description: ActuatorDescription) -> list[Segment | Defect]:
        """Apply a description; return the completed windows and defects.

        A changed description ends an open window; an unchanged description has no effect.
        """
        require_type("description", description, ActuatorDescription)
        if description == self.description:
            return []
        events = self.restart(self._settings, DescriptionChanged())
        self.description = description
        self._trigger = _trigger(description, self._settings)
        self._period_reported = False
        undescribed, self._undescribed = self._undescribed, deque()
        for item in undescribed:
            if isinstance(item, Defect):
                events += self._number(self._trigger.end_piece(item.stamp_ns, item.cause))
            else:
                events += self._scan(item, self._trigger, description)
        return events

    def restart(self, settings: TriggerSettings, cause: Reason) -> list[Segment | Defect]:
        """Restart with new settings; return the completed windows and defects.

        ``cause`` is the reason for the end of an open window.
        """
        self._settings = settings
        self._windows_before, self._samples = self.windows, 0
        self._run = self._longest_run = 0
        events: list[Segment | Defect] = []
        if self._trigger is not None and self._last is not None:
            events = self._number(self._trigger.end_piece(self._last.stamp_ns, cause))
        if self.description is not None:
            self._trigger = _trigger(self.description, settings)
        return events

    def feed(self, block: Telemetry) -> list[Segment | Defect]:
        """Process the next block; return the windows that it completes and its defects.

        Raises
        ------
        ValueError
            If ``block`` is not a `Telemetry`.
        """
        require_type("block", block, Telemetry)
        self.blocks += 1
        self._samples += len(block)
        if self._last is not None:
            missing = block.first_index - self._last.first_index - len(self._last)
            self.lost_samples += max(0, missing)
            is_continued = missing == 0 or (
                self.finds_records and lost_between(self._last, block) is not None
            )
            self._run = self._run + missing if is_continued else 0
        self._run += len(block)
        self._longest_run = max(self._longest_run, self._run)
        self._last, self._sample_period = block, block.sample_period
        self._lacks_command = not block.has_command
        if self._trigger is None or self.description is None:
            self._keep(block)
            return []
        return self._scan(block, self._trigger, self.description)

    def reject(self, stamp_ns: int, error: str) -> list[Segment | Defect]:
        """Process an invalid block, given its timestamp [ns] and the reason; return the events."""
        self.blocks += 1
        cause = MalformedBlock(error)
        if self._trigger is None:
            defect = Defect(stamp_ns, cause)
            self._keep(defect)
            return [defect]
        return self._number(self._trigger.end_piece(stamp_ns, cause))

    def split(self, block: Telemetry) -> list[Segment | Defect]:
        """End the current piece of telemetry if a block does not continue it.

        Returns the completed windows and the defect. ``feed`` does the same before it processes the
        block.
        """
        return self._number(self._trigger.split(block)) if self._trigger else []

    def finish(self) -> list[Segment | Defect]:
        """End the telemetry; return the completed record, or the refusal of an open window."""
        if self._trigger is None:
            return []
        events = self._number(self._trigger.finish())
        self._trigger.reset()
        self._last = None
        return events

    def _keep(self, item: Telemetry | Defect) -> None:
        """Keep an item until the description is received, and drop items that are too old."""
        kept = self._undescribed
        kept.append(item)
        oldest_ns = item.stamp_ns - round(LOOKBACK_S * 1e9)
        samples = sum(len(block) for block in kept if isinstance(block, Telemetry))
        while kept and (
            kept[0].stamp_ns < oldest_ns or samples > MOST_SAMPLES or len(kept) > MOST_BLOCKS
        ):
            dropped = kept.popleft()
            samples -= len(dropped) if isinstance(dropped, Telemetry) else 0

    def _scan(
        self, block: Telemetry, trigger: WindowTrigger, description: ActuatorDescription
    ) -> list[Segment | Defect]:
        events: list[Segment | Defect] = []
        period = description.sample_period
        if not self._period_reported and abs(block.sample_period / period - 1.0) > 1e-6:
            self._period_reported = True
            events.append(Defect(block.stamp_ns, OtherPeriod(period, block.sample_period)))
        return events + self._number(trigger.feed(block))

    def _number(self, events: Iterable[Window | Refusal | Defect]) -> list[Segment | Defect]:
        """Return the events with windows and refusals replaced by numbered segments."""
        numbered: list[Segment | Defect] = []
        for event in events:
            if isinstance(event, Defect):
                numbered.append(event)
            elif self.description is not None:
                is_stretch = isinstance(self._trigger, StretchTrigger)
                numbered.append(Segment(self.windows, self.description, event, is_stretch))
                self.windows += 1
        return numbered


def _trigger(description: ActuatorDescription, settings: TriggerSettings) -> WindowTrigger:
    if not description.is_modelled:
        return RecordTrigger(description.parameters, settings)
    if settings.windows == ANY_MOTION:
        return StretchTrigger(description.parameters, settings)
    return WindowTrigger(description.parameters, settings)
