# SPDX-License-Identifier: Apache-2.0
"""Detection of the windows in a recording, with only its latest telemetry in memory."""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final

from ema_bags.recording import MessagePlace
from ema_bags.telemetry import (
    MEASURED_TYPE,
    TRUE_FAULTS_TYPE,
    Malformed,
    RecordedTelemetry,
    read_telemetry,
)
from ema_core.causes import CauseEstimate
from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_core.wording import counted
from ema_monitor.intake import Intake
from ema_monitor.model.measurements import MAX_AGE_S, MeasurementLog
from ema_monitor.reason_texts import text_of
from ema_monitor.recordings.windows import BagWindows, RecordedWindow, WindowPlace
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Defect, Refusal, TriggerSettings
from ema_monitor.windows.window import Window
from ema_ros.messages import StampedFaults, measured_from_message, stamped_faults_from_message

_MOST_DEFECTS: Final = 5
# Place of each block, index of its first sample, and index after its last sample.
_Places = deque[tuple[MessagePlace, int, int]]


def read_windows(
    path: str | Path,
    settings: TriggerSettings | None = None,
    *,
    topic: str | None = None,
    actuator_id: str | None = None,
    description: ActuatorDescription | None = None,
    measured_max_age_s: float = MAX_AGE_S,
) -> BagWindows:
    """Return the windows in the telemetry of one actuator in a recording.

    Parameters
    ----------
    path
        The recording: an ``.mcap`` file, or a folder of ``ros2 bag record``.
    settings
        Settings of the detection; default settings if None.
    topic, actuator_id
        Topic and actuator to read, if the recording has telemetry on several topics or of several
        actuators.
    description
        Description of the actuator; None for the description in the recording.
    measured_max_age_s
        Largest age of a recorded measurement at the start of a window that uses it [s].

    Raises
    ------
    ValueError
        If the recording cannot be read, or has no such telemetry or no description.
    OSError
        If the recording cannot be opened.
    """
    from ema_bags.reader import Bag  # imports rosbags and mcap, which only bags need

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
    """Return the windows in recorded telemetry, with only its latest blocks in memory.

    Parameters
    ----------
    recorded
        Telemetry of one actuator in a recording.
    settings
        Settings of the detection; default settings if None.
    description
        Description of the actuator; None for the description in the recording.
    measured
        Measured causes for the whole recording; they replace recorded measurements of the same
        causes.
    measured_max_age_s
        Largest age of a recorded measurement at the start of a window that uses it [s].
    on_block
        Called with each block of telemetry.
    with_duty
        Whether to measure the flown duty, which compiles kernels.

    Raises
    ------
    ValueError
        If there is no usable telemetry, or no description.
    """
    bag, unit = recorded.bag, recorded.actuator_id
    if description is None and not recorded.descriptions:
        reason = f"{bag.path} has no description of actuator {unit!r}: pass one"
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
    # Places of the latest blocks that a window may span.
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
            oldest = finder.oldest_index(item)
            while len(latest) > 1 and latest[0][2] <= oldest:
                latest.popleft()
            latest.append((place, item.first_index, item.first_index + len(item)))
            take(intake.feed(item))
            if on_block is not None:
                on_block(item)
    take(event for event in intake.finish() if isinstance(event, Segment))
    obstacle = finder.shortage or finder.obstacle or (None if windows else finder.shortfall)
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
        remarks.append(f"{pieces} of the telemetry ignored: {text_of(finder.shortfall)}")
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
    segment: Segment, recorded: RecordedTelemetry, latest: _Places
) -> RecordedWindow:
    """Return the window that the last block completed, with the position of its samples."""
    window, play = segment.window, None
    measured: tuple[CauseEstimate, ...] = ()
    place: WindowPlace | Refusal
    if isinstance(window, Refusal):
        place = window
    else:
        start, stop = window.telemetry.first_index, window.telemetry.first_index + window.span
        # A window may begin or end at interpolated samples, which lie between two blocks.
        first, index, _ = [item for item in latest if item[1] <= start][-1]
        last = next((item for item in latest if item[2] >= stop), latest[-1])
        place = WindowPlace(recorded, first, last[0], start - index, window.span, window.omitted)
        play, measured = window.play, window.measured
    return RecordedWindow(
        segment.number,
        segment.description,
        window.start_ns,
        window.end_ns,
        play,
        place,
        measured,
        isinstance(window, Window) and window.is_remainder,
    )


def _recorded_measurements(recorded: RecordedTelemetry) -> tuple[MeasurementLog, list[str]]:
    """Return the measured causes of the actuator, and the defects of malformed messages."""
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
