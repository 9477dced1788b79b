"""From a bag to the windows in it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema_cli.chosen_description import choose_description
from ema_cli.progress import progress_bar
from ema_cli.source_options import Source
from ema_cli.truths import truth_at
from ema_core.description import ActuatorDescription
from ema_core.faults import healthy_faults
from ema_core.telemetry import Telemetry
from ema_interfaces.msg import FaultVectorStamped
from ema_messages.faults import StampedFaults, stamped_faults_from_message
from ema_monitor.trigger import Defect
from ema_monitor.watch import Found, Watch
from ema_recording.message_type import type_name
from ema_recording.reader import Bag
from ema_recording.telemetry import Malformed, read_telemetry

_MOST_DEFECTS = 5


@dataclass(frozen=True)
class BagWindows:
    """What a bag says of one actuator.

    Attributes
    ----------
    description
        The actuator as it was described last.
    first_ns
        Stamp of the first sample [ns].
    blocks
        All telemetry.
    windows
        Windows, and those that were begun and cannot be used, in order of time, each with the
        description of the actuator at its time.
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
    blocks: list[Telemetry]
    windows: list[Found]
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


def read_windows(path: Path, source: Source) -> BagWindows:
    """Read a bag and cut its telemetry into windows.

    Parameters
    ----------
    path
        Bag to read.
    source
        What of it to look at.

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
    watch = Watch(source.trigger_settings(), description)
    blocks: list[Telemetry] = []
    windows: list[Found] = []
    defects: list[Defect] = []
    remarks = [warning] if warning else []
    with progress_bar() as progress:
        total = bag.topics[recorded.topic].count
        for item in progress.track(recorded.items(), total=total, description=f"reading {path}"):
            if isinstance(item, ActuatorDescription):
                events = [] if is_forced else watch.describe(item)
            elif isinstance(item, Malformed):
                events = watch.reject(item.stamp_ns, item.reason)
            else:
                blocks.append(item)
                events = watch.feed(item)
            for event in events:
                if isinstance(event, Defect):
                    defects.append(event)
                else:
                    windows.append(event)
    windows += [event for event in watch.finish() if isinstance(event, Found)]
    first_ns = blocks[0].stamp_ns if blocks else 0
    for defect in defects[:_MOST_DEFECTS]:
        remarks.append(f"at {(defect.stamp_ns - first_ns) * 1e-9:.4f} s: {defect.reason}")
    if len(defects) > _MOST_DEFECTS:
        remarks.append(f"and {len(defects) - _MOST_DEFECTS} more defects of the telemetry")
    if bag.damage:
        remarks.append(bag.damage)
    if not blocks:
        raise ValueError(f"{path} has no usable telemetry: {'; '.join(remarks)}")
    return BagWindows(
        watch.description or description,
        first_ns,
        blocks,
        windows,
        remarks,
        watch.longest_motion_s,
        watch.has_rested,
        _recorded_truths(bag, recorded.actuator_id),
    )


def _recorded_truths(bag: Bag, actuator_id: str) -> list[StampedFaults]:
    wanted = type_name(FaultVectorStamped)
    topics = [name for name, topic in bag.topics.items() if topic.type_name == wanted]
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
