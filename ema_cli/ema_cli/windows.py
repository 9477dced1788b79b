"""From a bag to the windows in it."""

from dataclasses import dataclass
from pathlib import Path

from ema_cli.progress import progress_bar
from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_monitor.trigger import Defect, Refusal, TriggerSettings, WindowTrigger
from ema_monitor.window import Window
from ema_recording.reader import Bag
from ema_recording.telemetry import Malformed, read_telemetry


@dataclass(frozen=True)
class BagWindows:
    """What a bag says of one actuator.

    Attributes
    ----------
    description
        The actuator.
    first_ns
        Stamp of the first sample [ns].
    blocks
        All telemetry.
    windows
        Windows, and those that were begun and cannot be used, in order of time.
    remarks
        What is wrong with the bag or its telemetry outside of any window.
    longest_motion_s
        Longest motion of the command that was too short for a window [s].
    """

    description: ActuatorDescription
    first_ns: int
    blocks: list[Telemetry]
    windows: list[Window | Refusal]
    remarks: list[str]
    longest_motion_s: float

    def seconds(self, stamp_ns: int) -> float:
        """Return a stamp in seconds since the first sample."""
        return (stamp_ns - self.first_ns) * 1e-9


def read_windows(path: Path, actuator_id: str | None = None) -> BagWindows:
    """Read a bag and cut its telemetry into windows.

    Parameters
    ----------
    path
        Bag to read.
    actuator_id
        Which actuator, where there are several.

    Raises
    ------
    ValueError
        When the bag cannot be read, or has no telemetry or no description of the actuator.
    OSError
        When it cannot be opened.
    """
    bag = Bag(path)
    try:
        recorded = read_telemetry(bag, actuator_id=actuator_id)
    except ValueError as error:
        raise ValueError("; ".join(filter(None, (str(error), bag.damage)))) from error
    if not recorded.descriptions:
        raise ValueError(f"{path} has no description of actuator {recorded.actuator_id!r}")
    description = recorded.descriptions[-1]
    trigger = WindowTrigger(description.parameters)
    blocks: list[Telemetry] = []
    windows: list[Window | Refusal] = []
    remarks = []
    if len(recorded.descriptions) > 1:
        remarks.append("the description changes on the way: the last one is used")
    with progress_bar() as progress:
        total = bag.topics[recorded.topic].count
        for item in progress.track(recorded.blocks(), total=total, description=f"reading {path}"):
            if isinstance(item, Malformed):
                events = [trigger.interrupt(item.stamp_ns, item.reason)]
            else:
                blocks.append(item)
                events = trigger.feed(item)
            for event in events:
                if isinstance(event, Defect):
                    remarks.append(f"at {event.stamp_ns * 1e-9:.4f} s: {event.reason}")
                else:
                    windows.append(event)
    windows += trigger.finish()
    if bag.damage:
        remarks.append(bag.damage)
    if not blocks:
        raise ValueError(f"{path} has no usable telemetry: {'; '.join(remarks)}")
    return BagWindows(
        description, blocks[0].stamp_ns, blocks, windows, remarks, trigger.longest_motion_s
    )


def require_windows(path: Path, found: BagWindows) -> None:
    """Raise unless a window was at least begun.

    Parameters
    ----------
    path
        The bag, for the message.
    found
        What is in it.

    Raises
    ------
    ValueError
        When there is no window; the message tells what the command did.
    """
    if found.windows:
        return
    window_s = TriggerSettings().window_s
    moved = (
        f"it moved for at most {found.longest_motion_s:.3f} s between two rests"
        if found.longest_motion_s
        else "it never left its rest"
    )
    raise ValueError(
        f"{path} has no window to diagnose (no excitation): a window is {window_s:g} s of moving "
        f"command after a rest, and {moved}"
    )
