# SPDX-License-Identifier: Apache-2.0
"""``ema info``: show the content of a bag."""

from dataclasses import replace
from pathlib import Path
from typing import Final

import click

from ema_bags.telemetry import described_actuators
from ema_cli.bags.reading import (
    ReadingOptions,
    accept_option,
    open_recording,
    read_windows,
    why_no_window,
)
from ema_cli.parameters import settings_options
from ema_core.parameters import NEUTRAL
from ema_core.wording import counted, text_table
from ema_monitor.recordings.windows import BagWindows
from ema_monitor.windows.trigger import Refusal

_OF_UNKNOWN: Final = ("tau", "k_t", "lead")
"""Parameters of a description with ``drive: unknown`` that are used."""


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@settings_options(ReadingOptions, more=[accept_option()])
def info(bag: Path, options: ReadingOptions) -> None:
    """Show the content of BAG: topics, actuator, telemetry, windows, and defects."""
    contents, options = open_recording(bag, options)
    counts = contents.readable_counts()
    rows = [(name, topic.type_name, str(counts[name])) for name, topic in contents.topics.items()]
    click.echo(text_table(("topic", "type", "messages"), rows))
    if contents.writers:
        click.echo(f"written by {', '.join(contents.writers)}")
    # Each defect of the bag is reported once, also if an actuator cannot be read.
    remarks: dict[str, None] = {}
    present, chosen = described_actuators(contents), [options]
    if options.actuator_id is None and len(present) > 1:
        chosen = [replace(options, actuator_id=name) for name in present]
    for source in chosen:
        try:
            bag_windows = read_windows(bag, source, bag=contents)
        except ValueError as error:
            if len(chosen) == 1:
                raise
            remarks[f"actuator {source.actuator_id}: {error}"] = None
            continue
        _show(bag_windows)
        remarks |= dict.fromkeys(bag_windows.remarks)
        if not bag_windows.windows:
            remarks[why_no_window(bag, bag_windows, source)] = None
    for remark in remarks | dict.fromkeys(contents.remarks):
        click.echo(f"warning: {remark}")


def _show(bag_windows: BagWindows) -> None:
    unit = bag_windows.description
    words = f"actuator {unit.actuator_id}", f"serial number {unit.serial_number}", unit.model
    click.echo(", ".join(filter(None, words)))
    nominal = unit.parameters.as_mapping()
    if not unit.is_modelled:
        # All other parameters come from the built-in actuator and are not used.
        used = (name for name in _OF_UNKNOWN if nominal[name] not in (0.0, NEUTRAL.get(name)))
        nominal = {name: nominal[name] for name in used}
    if nominal:
        click.echo("nominal parameters: " + ", ".join(f"{k} {v:g}" for k, v in nominal.items()))
    samples, period = bag_windows.samples, bag_windows.sample_period
    click.echo(
        f"telemetry: {counted(samples, 'sample')} every {period:g} s in "
        f"{counted(bag_windows.blocks, 'block')}, {samples * period:.3f} s"
    )
    click.echo(f"{bag_windows.kind}s: {len(bag_windows.windows)}")
    for window in bag_windows.windows:
        start, end = bag_windows.seconds(window.start_ns), bag_windows.seconds(window.end_ns)
        if isinstance(window.place, Refusal):
            state = window.place.reason
        elif bag_windows.kind == "record":
            state = f"{end - start:.1f} s, usable"
        else:
            play = "unknown" if window.play is None else f"{window.play:+g}"
            state = f"start in the play {play}"
        click.echo(f"  {start:.4f} s to {end:.4f} s: {state}")
