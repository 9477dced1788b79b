"""From a recording to the windows in it, without keeping its telemetry."""

from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.messages import MessagePlace
from ema_bags.telemetry import (
    MEASURED_TYPE,
    TRUE_FAULTS_TYPE,
    Malformed,
    RecordedTelemetry,
    read_telemetry,
)
from ema_core.causes import CauseEstimate
from ema_core.description import ActuatorDescription, UnitKey
from ema_core.faults import healthy_faults
from ema_core.telemetry import Telemetry, bridged, join
from ema_core.wording import counted
from ema_monitor.intake import Intake
from ema_monitor.model.measurements import MAX_AGE_S, MeasurementLog
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Defect, Refusal, TriggerSettings
from ema_monitor.windows.window import Window
from ema_ros.messages import StampedFaults, measured_from_message, stamped_faults_from_message

if TYPE_CHECKING:  # an estimate alone needs no prognosis
    from ema_monitor.prognosis.duty.damage import FlownDuty

_MOST_DEFECTS: Final = 5
_KEPT_WINDOWS: Final = 64
_KEPT_SAMPLES: Final = 2_000_000
# Place, index of the first sample, and index after the last one, of each block.
_Places = deque[tuple[MessagePlace, int, int]]


@dataclass(frozen=True)
class WindowPlace:
    """Where the samples of a window are in a bag.

    Attributes
    ----------
    first, last
        Places of the blocks that hold the first and the last of them.
    offset, samples
        Where they begin in the first block, and how many there are.
    """

    recorded: RecordedTelemetry
    first: MessagePlace
    last: MessagePlace
    offset: int
    samples: int

    def read(self) -> Telemetry:
        """Read the samples."""
        items = self.recorded.items(self.first, self.last)
        blocks = [item for _, item in items if isinstance(item, Telemetry)]
        return join(bridged(blocks)).part(self.offset, self.offset + self.samples)


@dataclass(frozen=True)
class RecordedWindow:
    """A window in a bag, or one that was begun and cannot be used; its telemetry stays there.

    Attributes
    ----------
    number
        Its running number, from 0.
    description
        The actuator, as it was described at the time.
    start_ns, end_ns
        Stamps of its first and last sample [ns].
    play
        Where in its play the motor stands at the start [half-widths]; None when unknown.
    place
        Where its samples are, or why it cannot be used.
    measured
        Hidden causes that were measured.
    """

    number: int
    description: ActuatorDescription
    start_ns: int
    end_ns: int
    play: float | None
    place: WindowPlace | Refusal
    measured: tuple[CauseEstimate, ...] = ()

    @property
    def window(self) -> Window | Refusal:
        """The window, read from the bag each time, or the reason why there is none."""
        if isinstance(self.place, Refusal):
            return self.place
        return Window(self.place.read(), self.play, self.measured)


@dataclass(frozen=True)
class BagWindows:
    """Content of a bag for one actuator.

    Attributes
    ----------
    description
        The actuator as it was described last.
    first_ns
        Stamp of the first sample [ns].
    sample_period
        Period of the samples in the first block [s].
    windows
        Windows, and those that were begun and cannot be used, in order of time.
    remarks
        Defects of the bag, or of its telemetry outside of any window.
    longest_motion_s
        Longest motion of the command, or for records of the position, that made no window [s].
    has_rested
        Whether the command, or for records the position, was ever at rest.
    obstacle
        Why no window could be complete; empty where one could, or nothing is known of it.
    truths
        True faults of the actuator by test cycle, in order, where the bag records them.
    flown
        Duty by unit, up to the end of each window and of the bag, by stamp [ns]; empty if it was
        not measured.
    """

    description: ActuatorDescription
    first_ns: int
    sample_period: float
    blocks: int
    samples: int
    windows: list[RecordedWindow]
    remarks: list[str]
    longest_motion_s: float
    has_rested: bool
    obstacle: str
    truths: list[StampedFaults]
    flown: "dict[UnitKey, list[tuple[int, FlownDuty]]]" = field(default_factory=dict)

    @property
    def usable(self) -> Sequence[Window]:
        """Windows that can be used; each is read from the recording when it is looked at."""
        return WindowsOnDemand(self.windows)

    @property
    def kind(self) -> str:
        """What the windows are called: records, if the drive is unknown."""
        return "record" if self.description.drive == "unknown" else "window"

    @property
    def simulated_faults(self) -> bool:
        """Whether the bag records that the actuator was simulated with faults."""
        healthy = healthy_faults()
        return any(not np.array_equal(truth.faults, healthy) for truth in self.truths)

    def __str__(self) -> str:
        unit = self.description
        lines = [
            f"{unit.actuator_id} ({unit.serial_number}), "
            f"{self.samples * self.sample_period:.3f} s of telemetry, "
            f"{counted(len(self.windows), self.kind)}"
        ]
        for item in self.windows:
            state = item.place.reason if isinstance(item.place, Refusal) else "usable"
            start, end = self.seconds(item.start_ns), self.seconds(item.end_ns)
            lines.append(f"{item.number:4d}  {start:.4f} s to {end:.4f} s: {state}")
        return "\n".join([*lines, *self.remarks])

    def seconds(self, stamp_ns: int) -> float:
        """Return a stamp in seconds since the first sample."""
        return (stamp_ns - self.first_ns) * 1e-9

    def true_faults(self, start_ns: int) -> NDArray[np.float64] | None:
        """Return the true faults, ``(8,)``, of a window by its start; None where not recorded."""
        truth = truth_at(self.truths, start_ns)
        return None if truth is None else truth.faults


class WindowsOnDemand(Sequence[Window]):
    """Usable windows that are read from their recording when they are accessed.

    The latest 64 stay in memory, or fewer if they would have more than 2 million samples.

    Parameters
    ----------
    windows
        Windows of one or several recordings; those that cannot be used are left out.
    """

    def __init__(self, windows: Sequence[RecordedWindow]) -> None:
        self._places = [item for item in windows if isinstance(item.place, WindowPlace)]
        lengths = [item.place.samples for item in windows if isinstance(item.place, WindowPlace)]
        kept = max(1, min(_KEPT_WINDOWS, _KEPT_SAMPLES // max(lengths, default=1)))
        self._read = lru_cache(kept)(lambda number: self._places[number].window)

    def __len__(self) -> int:
        return len(self._places)

    def __getitem__(self, number: Any) -> Any:
        if isinstance(number, slice):
            return WindowsOnDemand(self._places[number])
        return self._read(range(len(self))[number])


def read_windows(
    path: str | Path,
    settings: TriggerSettings | None = None,
    *,
    topic: str | None = None,
    actuator_id: str | None = None,
    description: ActuatorDescription | None = None,
    measured_max_age_s: float = MAX_AGE_S,
) -> BagWindows:
    """Read a recording and find the windows in the telemetry of one actuator.

    Parameters
    ----------
    path
        The recording: an ``.mcap`` file, or a folder as ``ros2 bag record`` makes it.
    settings, description, measured_max_age_s
        As of ``find_recorded_windows``.
    topic, actuator_id
        Which telemetry; needed where there is a choice.

    Raises
    ------
    ValueError
        When the recording cannot be read, or has no such telemetry or no description.
    OSError
        When it cannot be opened.
    """
    from ema_bags.reader import Bag  # rosbags and mcap only for bags

    recorded = read_telemetry(Bag(path), topic, actuator_id)
    return find_recorded_windows(
        recorded, settings, description=description, measured_max_age_s=measured_max_age_s
    )


def find_recorded_windows(
    recorded: RecordedTelemetry,
    settings: TriggerSettings | None = None,
    *,
    description: ActuatorDescription | None = None,
    measured: Sequence[CauseEstimate] = (),
    measured_max_age_s: float = MAX_AGE_S,
    on_block: Callable[[Telemetry], None] | None = None,
    with_duty: bool = False,
) -> BagWindows:
    """Find the windows in recorded telemetry, which is kept no longer than needed.

    Parameters
    ----------
    description
        The actuator; as the recording describes it when None.
    measured
        Causes that were measured throughout; each replaces the recorded measurements of it.
    measured_max_age_s
        Age at the start of a window up to which a recorded measurement holds for it [s].
    with_duty
        Whether to measure the duty that was flown, for which kernels are compiled.

    Raises
    ------
    ValueError
        When there is no usable telemetry, or no description.
    """
    bag, unit = recorded.bag, recorded.actuator_id
    if description is None and not recorded.descriptions:
        reason = f"{bag.path} has no description of actuator {unit!r}: give one"
        raise ValueError("; ".join(filter(None, (reason, bag.damage))))
    measurements, wrong = _recorded_measurements(recorded)
    intake = Intake(
        unit,
        settings or TriggerSettings(),
        description or recorded.descriptions[0],
        measurements=measurements,
        measured=measured,
        max_age_s=lambda: measured_max_age_s,
        most_pieces=None,
        measures_duty=with_duty,
    )
    finder = intake.finder
    # Places of the latest blocks, as many as a window may reach back over.
    latest: _Places = deque()
    first: Telemetry | None = None
    blocks = samples = last_ns = 0
    windows: list[RecordedWindow] = []
    defects: list[Defect] = []

    def take(events: Iterable[Segment | Defect]) -> None:
        for event in events:
            if isinstance(event, Defect):
                defects.append(event)
            else:
                windows.append(_recorded_window(event, recorded, latest))

    for place, item in recorded.items():
        if isinstance(item, ActuatorDescription):
            take(intake.describe(item) if description is None else [])
        elif isinstance(item, Malformed):
            take(intake.reject(item.stamp_ns, item.reason))
        else:
            first = first or item.part(0, 1)
            blocks, samples = blocks + 1, samples + len(item)
            last_ns = item.stamp_at(len(item) - 1)
            if latest and latest[-1][2] > item.first_index:
                take(intake.split(item))
                latest.clear()
            reach = round(finder.reach_s(item.sample_period) / item.sample_period) + 1
            while latest and latest[0][2] <= latest[-1][2] - reach:
                latest.popleft()
            latest.append((place, item.first_index, item.first_index + len(item)))
            take(intake.feed(item))
            if on_block is not None:
                on_block(item)
    take(event for event in intake.finish() if isinstance(event, Segment))
    obstacle = finder.shortage or finder.obstacle or ("" if windows else finder.shortfall)
    truths = _recorded_truths(recorded)
    first_ns = first.stamp_ns if first else 0
    remarks = [
        f"at {(defect.stamp_ns - first_ns) * 1e-9:.4f} s: {defect.reason}"
        for defect in defects[:_MOST_DEFECTS]
    ]
    if more := defects[_MOST_DEFECTS:]:
        remarks.append(f"and {counted(len(more), 'more defect')} of the telemetry")
    if lost := finder.interpolated_samples:
        remarks.append(f"{counted(lost, 'lost sample')} of {samples + lost} interpolated")
    if windows and finder.shortfall:
        pieces = counted(finder.passed_over, "piece")
        remarks.append(f"{pieces} of the telemetry passed over: {finder.shortfall}")
    if wrong:
        count = counted(len(wrong), "impossible measurement")
        remarks.append(f"ignored: {count}, the latest: {wrong[-1]}")
    remarks += bag.remarks
    if first is None or finder.description is None:
        raise ValueError(f"{bag.path} has no usable telemetry: {'; '.join(remarks)}")
    return BagWindows(
        finder.description,
        first_ns,
        first.sample_period,
        blocks,
        samples,
        windows,
        remarks,
        finder.longest_motion_s,
        finder.has_rested,
        obstacle,
        truths,
        intake.pieces(last_ns),
    )


def _recorded_window(
    found: Segment, recorded: RecordedTelemetry, latest: _Places
) -> RecordedWindow:
    """Return a window that the last block completed, with the place of its samples."""
    window, play = found.window, None
    measured: tuple[CauseEstimate, ...] = ()
    place: WindowPlace | Refusal
    if isinstance(window, Refusal):
        place = window
    else:
        start, samples = window.telemetry.first_index, len(window.telemetry)
        # It may begin or end among interpolated samples, which are between two blocks.
        first, index, _ = [item for item in latest if item[1] <= start][-1]
        last = next((item for item in latest if item[2] >= start + samples), latest[-1])
        place = WindowPlace(recorded, first, last[0], start - index, samples)
        play, measured = window.play, window.measured
    return RecordedWindow(
        found.number, found.description, window.start_ns, window.end_ns, play, place, measured
    )


def _recorded_measurements(recorded: RecordedTelemetry) -> tuple[MeasurementLog, list[str]]:
    """Return the measurements of the actuator, and the defects of its other messages."""
    log, wrong = MeasurementLog(), []
    for item in recorded.bag.messages(recorded.bag.topics_of(MEASURED_TYPE)):
        if item.message.actuator_id == recorded.actuator_id:
            try:
                log.add(recorded.actuator_id, *measured_from_message(item.message))
            except ValueError as error:
                wrong.append(str(error))
    return log, wrong


def _recorded_truths(recorded: RecordedTelemetry) -> list[StampedFaults]:
    bag, truths = recorded.bag, []
    for item in bag.messages(bag.topics_of(TRUE_FAULTS_TYPE)):
        if item.message.actuator_id == recorded.actuator_id:
            try:
                truths.append(stamped_faults_from_message(item.message))
            except ValueError as error:
                bag.malformed.note(item, str(error))
    return truths


def truth_at(truths: Sequence[StampedFaults], start_ns: int) -> StampedFaults | None:
    """Return the true faults of the test cycle that runs at a time; None before the first."""
    before = bisect_right(truths, start_ns, key=lambda truth: truth.stamp_ns)
    return truths[before - 1] if before else None
