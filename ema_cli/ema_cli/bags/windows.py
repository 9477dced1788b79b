"""From a bag to the windows in it, without keeping its telemetry."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema_cli.bags.chosen_description import choose_description
from ema_cli.bags.source_options import Source
from ema_cli.bags.truths import truth_at
from ema_cli.show.progress import progress_bar
from ema_core.description import ActuatorDescription
from ema_core.faults import healthy_faults
from ema_core.telemetry import Telemetry, join
from ema_core.wording import counted
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import Defect, Refusal
from ema_monitor.windows.window import Window
from ema_recording.reader import Bag, Place
from ema_recording.telemetry import (
    TRUE_FAULTS_TYPE,
    Malformed,
    RecordedTelemetry,
    read_telemetry,
)
from ema_ros.faults import StampedFaults, stamped_faults_from_message

_MOST_DEFECTS = 5


@dataclass(frozen=True)
class WindowPlace:
    """Where the samples of a window are in a bag.

    Attributes
    ----------
    recorded
        The telemetry that they are part of.
    first, last
        Places of the blocks that hold the first and the last of them.
    offset, samples
        Where they begin in the first block, and how many there are.
    """

    recorded: RecordedTelemetry
    first: Place
    last: Place
    offset: int
    samples: int

    def read(self) -> Telemetry:
        """Read the samples."""
        items = self.recorded.items(self.first, self.last)
        blocks = [item for _, item in items if isinstance(item, Telemetry)]
        return join(blocks).part(self.offset, self.offset + self.samples)


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
    """

    number: int
    description: ActuatorDescription
    start_ns: int
    end_ns: int
    play: float | None
    place: WindowPlace | Refusal

    @property
    def window(self) -> Window | Refusal:
        """The window, read from the bag anew each time, or why there is none."""
        if isinstance(self.place, Refusal):
            return self.place
        return Window(self.place.read(), self.play)

    def load(self) -> Segment:
        """Return what was found, with its telemetry."""
        return Segment(self.number, self.description, self.window)


@dataclass(frozen=True)
class BagWindows:
    """What a bag says of one actuator.

    Attributes
    ----------
    description
        The actuator as it was described last.
    first_ns
        Stamp of the first sample [ns].
    sample_period
        Period of the samples in the first block [s].
    blocks, samples
        How many blocks and samples of telemetry there are.
    windows
        Windows, and those that were begun and cannot be used, in order of time.
    remarks
        What is wrong with the bag or its telemetry outside of any window.
    longest_motion_s
        Longest motion of the command that made no window [s].
    has_rested
        Whether the command was ever at rest.
    truths
        True faults of the actuator by test cycle, in order, where the bag records them.
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
    truths: list[StampedFaults]

    @property
    def simulated_faults(self) -> bool:
        """Whether the bag says that the actuator was simulated with faults."""
        healthy = healthy_faults()
        return any(not np.array_equal(truth.faults, healthy) for truth in self.truths)

    def seconds(self, stamp_ns: int) -> float:
        """Return a stamp in seconds since the first sample."""
        return (stamp_ns - self.first_ns) * 1e-9

    def true_faults(self, start_ns: int) -> NDArray[np.float64] | None:
        """Return the true faults, ``(8,)``, of a window by its start; None where not recorded."""
        truth = truth_at(self.truths, start_ns)
        return None if truth is None else truth.faults


class _LatestBlocks:
    """Places of the latest blocks without a gap, as many as a window may reach back over.

    Parameters
    ----------
    recorded
        The telemetry.
    window_s
        Length of a window [s].
    """

    def __init__(self, recorded: RecordedTelemetry, window_s: float) -> None:
        self._recorded = recorded
        self._window_s = window_s
        self._blocks: deque[tuple[Place, int, int]] = deque()

    def append(self, place: Place, block: Telemetry) -> None:
        """Add the next block."""
        if self._blocks and self._blocks[-1][2] != block.first_index:
            self._blocks.clear()
        self._blocks.append((place, block.first_index, block.first_index + len(block)))
        oldest = block.first_index - round(self._window_s / block.sample_period) - 1
        while self._blocks[0][2] <= oldest:
            self._blocks.popleft()

    def place_of(self, window: Window) -> WindowPlace:
        """Return where the samples of a window are that the last block completed."""
        start = window.telemetry.first_index
        place, first_index, _ = next(item for item in self._blocks if item[2] > start)
        last = self._blocks[-1][0]
        return WindowPlace(self._recorded, place, last, start - first_index, len(window.telemetry))


def read_windows(
    path: Path, source: Source, on_block: Callable[[Telemetry], None] | None = None
) -> BagWindows:
    """Read a bag and find the windows in its telemetry, which is kept no longer than needed.

    Parameters
    ----------
    path
        Bag to read.
    source
        What of it to look at.
    on_block
        Called with each block of telemetry.

    Raises
    ------
    ValueError
        When the bag cannot be read, or has no telemetry or no description of the actuator.
    OSError
        When it cannot be opened.
    """
    bag = Bag(path)
    try:
        recorded = read_telemetry(bag, source.topic, source.actuator_id)
    except ValueError as error:
        raise ValueError("; ".join(filter(None, (str(error), bag.damage)))) from error
    description, warning = choose_description(
        path, recorded.actuator_id, recorded.descriptions, source
    )
    is_forced = source.force and source.actuator_file is not None
    settings = source.trigger_settings()
    watch = WindowFinder(settings, description)
    latest = _LatestBlocks(recorded, settings.window_s)
    first: Telemetry | None = None
    blocks = samples = defects = 0
    windows: list[RecordedWindow] = []
    named_defects: list[Defect] = []
    with progress_bar() as progress:
        total = bag.topics[recorded.topic].count
        items = progress.track(recorded.items(), total=total, description=f"reading {path}")
        for place, item in items:
            if isinstance(item, ActuatorDescription):
                events = [] if is_forced else watch.describe(item)
            elif isinstance(item, Malformed):
                events = watch.reject(item.stamp_ns, item.reason)
            else:
                first = first or item.part(0, 1)
                blocks, samples = blocks + 1, samples + len(item)
                latest.append(place, item)
                events = watch.feed(item)
                if on_block is not None:
                    on_block(item)
            for event in events:
                if isinstance(event, Segment):
                    windows.append(_recorded_window(event, latest))
                else:
                    defects += 1
                    named_defects += [event] if defects <= _MOST_DEFECTS else []
    windows += [
        _recorded_window(event, latest) for event in watch.finish() if isinstance(event, Segment)
    ]
    first_ns = first.stamp_ns if first else 0
    remarks = [warning] if warning else []
    for defect in named_defects:
        remarks.append(f"at {(defect.stamp_ns - first_ns) * 1e-9:.4f} s: {defect.reason}")
    if defects > _MOST_DEFECTS:
        remarks.append(f"and {counted(defects - _MOST_DEFECTS, 'more defect')} of the telemetry")
    if bag.damage:
        remarks.append(bag.damage)
    if first is None:
        raise ValueError(f"{path} has no usable telemetry: {'; '.join(remarks)}")
    return BagWindows(
        watch.description or description,
        first_ns,
        first.sample_period,
        blocks,
        samples,
        windows,
        remarks,
        watch.longest_motion_s,
        watch.has_rested,
        _recorded_truths(bag, recorded.actuator_id),
    )


def _recorded_window(found: Segment, latest: _LatestBlocks) -> RecordedWindow:
    window = found.window
    is_whole = isinstance(window, Window)
    return RecordedWindow(
        found.number,
        found.description,
        window.start_ns,
        window.end_ns,
        window.play if is_whole else None,
        latest.place_of(window) if is_whole else window,
    )


def _recorded_truths(bag: Bag, actuator_id: str) -> list[StampedFaults]:
    topics = [name for name, topic in bag.topics.items() if topic.type_name == TRUE_FAULTS_TYPE]
    truths = [stamped_faults_from_message(item.message) for item in bag.messages(topics)]
    return [truth for truth in truths if truth.actuator_id == actuator_id]


def require_windows(path: Path, found: BagWindows, source: Source) -> None:
    """Raise unless a window was at least begun.

    Parameters
    ----------
    path
        The bag, for the message.
    found
        What is in it.
    source
        What of it was looked at.

    Raises
    ------
    ValueError
        When there is no window; the message tells what the command did.
    """
    if found.windows:
        return
    settings = source.trigger_settings()
    if not found.has_rested:
        behaviour = (
            f"it never rested within {settings.threshold:g} rad for {settings.rest_s:g} s: is "
            "--threshold below its noise?"
        )
    elif found.longest_motion_s:
        behaviour = (
            f"it moved for at most {found.longest_motion_s:.3f} s at a time, or one way only"
        )
    else:
        behaviour = "it never left its rest"
    raise ValueError(
        f"{path} has no window to diagnose (no excitation): a window is {settings.window_s:g} s of "
        f"command moving to and fro after a rest, and {behaviour}"
    )
