"""Windows in a bag, as the options say."""

from collections.abc import Callable
from pathlib import Path

from ema_cli.bags.chosen_description import choose_description
from ema_cli.bags.source_options import Source
from ema_cli.show.progress import progress_bar
from ema_core.telemetry import Telemetry
from ema_recording.windows import BagWindows, find_recorded_windows, open_telemetry


def read_windows(
    path: Path, source: Source, on_block: Callable[[Telemetry], None] | None = None
) -> BagWindows:
    """Read a bag and find the windows in its telemetry, with a progress bar.

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
    recorded = open_telemetry(path, source.topic, source.actuator_id)
    description, warning = choose_description(
        path, recorded.actuator_id, recorded.descriptions, source
    )
    with progress_bar() as progress:
        total = recorded.bag.topics[recorded.topic].count
        task = progress.add_task(f"reading {path}", total=total)

        def follow(block: Telemetry) -> None:
            progress.advance(task)
            if on_block is not None:
                on_block(block)

        found = find_recorded_windows(
            recorded, source.trigger_settings(), description=description, on_block=follow
        )
    if warning:
        found.remarks.insert(0, warning)
    return found


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
