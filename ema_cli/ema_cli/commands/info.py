"""``ema info``: what is in a bag."""

from pathlib import Path

import click

from ema_bags.reader import Bag
from ema_cli.bags.source_options import SourceOptions, source_options
from ema_cli.bags.windows import read_windows
from ema_cli.errors import one_clear_line
from ema_core.wording import counted, text_table
from ema_monitor.windows.trigger import Refusal


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@source_options()
def info(bag: Path, source: SourceOptions) -> None:
    """Show what BAG holds: topics, actuator, telemetry, windows, and what is wrong with it."""
    with one_clear_line():
        contents = Bag(bag)
        counts = contents.readable_counts()
        rows = [
            (name, topic.type_name, str(counts[name])) for name, topic in contents.topics.items()
        ]
        click.echo(text_table(("topic", "type", "messages"), rows))
        if contents.writers:
            click.echo(f"written by {', '.join(contents.writers)}")
        found = read_windows(bag, source, bag=contents)
    unit = found.description
    click.echo(f"actuator {unit.actuator_id}, serial number {unit.serial_number}, {unit.model}")
    nominal = unit.parameters.as_mapping()
    click.echo("nominal parameters: " + ", ".join(f"{k} {v:g}" for k, v in nominal.items()))
    click.echo(
        f"telemetry: {counted(found.samples, 'sample')} every {found.sample_period:g} s in "
        f"{counted(found.blocks, 'block')}, {found.samples * found.sample_period:.3f} s"
    )
    click.echo(f"windows: {len(found.windows)}")
    for window in found.windows:
        start, end = found.seconds(window.start_ns), found.seconds(window.end_ns)
        state = (
            window.place.reason
            if isinstance(window.place, Refusal)
            else f"start in the play {'unknown' if window.play is None else f'{window.play:+g}'}"
        )
        click.echo(f"  {start:.4f} s to {end:.4f} s: {state}")
    for remark in found.remarks:
        click.echo(f"warning: {remark}")
