"""Windows in a bag, as the options say."""

from collections.abc import Callable
from pathlib import Path

import click

from ema_bags.reader import Bag
from ema_bags.telemetry import read_telemetry
from ema_bags.windows import BagWindows, find_recorded_windows
from ema_cli.bags.chosen_description import choose_description
from ema_cli.bags.source_options import SourceOptions
from ema_cli.show.progress import progress_bar
from ema_core.telemetry import Telemetry
from ema_monitor.model.measured import measured_causes_of
from ema_monitor.windows.window import MIN_TRAVEL


def read_windows(
    path: Path,
    source: SourceOptions,
    on_block: Callable[[Telemetry], None] | None = None,
    bag: Bag | None = None,
    *,
    with_duty: bool = False,
) -> BagWindows:
    """Read a bag and find the windows in its telemetry, with a progress bar.

    Parameters
    ----------
    path
        The bag.
    source
        What of it to look at.
    on_block
        Called with each block of telemetry.
    bag
        The bag, where it is open already.
    with_duty
        Whether to measure the duty that was flown.

    Raises
    ------
    ValueError
        When the bag cannot be read, or has no telemetry or no description of the actuator; when
        a cause cannot have been measured as the options say.
    OSError
        When it cannot be opened.
    """
    measured = measured_causes_of(source.measured)
    bag = bag or Bag(path)
    recorded = read_telemetry(bag, source.topic, source.actuator_id)
    try:
        description, warning = choose_description(
            path, recorded.actuator_id, recorded.descriptions, source
        )
    except ValueError as error:
        raise ValueError("; ".join(filter(None, (str(error), bag.damage)))) from error
    with progress_bar() as progress:
        total = recorded.bag.topics[recorded.topic].count
        task = progress.add_task(f"reading {path}", total=total)

        def follow(block: Telemetry) -> None:
            progress.advance(task)
            if on_block is not None:
                on_block(block)

        found = find_recorded_windows(
            recorded,
            source.trigger_settings(),
            description=description,
            measured_max_age_s=source.measured_max_age_s,
            on_block=follow,
            with_duty=with_duty,
        )
    if measured:
        found = found.with_measured(measured)
    found.remarks[:0] = [*([warning] if warning else []), *found.description.remarks]
    return found


def identifiable_windows(path: Path, source: SourceOptions) -> BagWindows:
    """Return what ``read_windows`` does, with the remarks printed; at least one window was begun.

    Raises
    ------
    ValueError
        As ``read_windows``, or when there is no window.
    OSError
        When the bag cannot be opened.
    """
    found = read_windows(path, source)
    for remark in found.remarks:
        click.echo(f"{path}: {remark}", err=True)
    require_windows(path, found, source)
    return found


def require_windows(path: Path, found: BagWindows, source: SourceOptions) -> None:
    """Raise unless a window was at least begun.

    Raises
    ------
    ValueError
        When there is no window; the message describes the command.
    """
    if found.windows:
        return
    settings = source.trigger_settings()
    if source.any_motion:
        if found.obstacle:
            raise ValueError(f"{path} has no window to diagnose: {found.obstacle}")
        raise ValueError(
            f"{path} has no motion to diagnose (no excitation): the command never travels "
            f"{MIN_TRAVEL:g} rad within {settings.window_s:g} s"
        )
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
        + (f"; {found.obstacle}" if found.obstacle else "")
    )
