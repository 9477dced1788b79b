# SPDX-License-Identifier: Apache-2.0
"""``ema import``: import telemetry from third-party files and bags."""

from pathlib import Path

import click

from ema_bags.inputs.files import open_input
from ema_bags.inputs.mapping import load_mapping, mapping_text
from ema_cli.bags.guide import mapping_of
from ema_cli.bags.reading import ReadingOptions, read_windows
from ema_cli.bags.records import actuators_of, described, read_records, write_records
from ema_cli.output import BAG_TO_WRITE, output_option, require_free
from ema_core.wording import counted


@click.command("import")
@click.argument(
    "files", nargs=-1, required=True, metavar="FILE...", type=click.Path(path_type=Path)
)
@click.option(
    "--mapping",
    "mapping_file",
    type=click.Path(path_type=Path),
    help="YAML file that maps the columns of FILE to telemetry (docs/inputs.md).",
)
@click.option(
    "--guide", is_flag=True, help="Ask for the mapping, and write it next to OUTPUT with a picture."
)
@click.option(
    "--set",
    "entries",
    multiple=True,
    metavar="ENTRY=VALUE",
    help="Mapping entry to use instead of a guess or question: position.unit=mm.",
)
@click.option(
    "--actuator",
    "actuator_file",
    type=click.Path(path_type=Path),
    help="Actuator file (YAML); by default the built-in actuator.",
)
@click.option("--accept-defects", is_flag=True, help="Write the bag despite defects in the data.")
@output_option(BAG_TO_WRITE)
def import_(
    files: tuple[Path, ...],
    mapping_file: Path | None,
    guide: bool,
    entries: tuple[str, ...],
    actuator_file: Path | None,
    overwrite: bool,
    accept_defects: bool,
    output: Path,
) -> None:
    """Convert third-party telemetry in each FILE to a bag for the other commands.

    A FILE is a table (CSV, Parquet, .npz), a bag of rosbag2, or the folder of a LeRobot data set.
    `ema check` recognises the columns and writes the file for --mapping. Wrong units, signs,
    ratios or time stamps are reported, and nothing is written unless --accept-defects is given.
    """
    is_asked = guide or bool(entries)
    if is_asked and mapping_file is not None:
        raise click.UsageError("--mapping excludes --guide and --set")
    if mapping_file is None and not is_asked:
        raise click.UsageError(
            f"--mapping is missing: `ema check {files[0]} -o mapping.yaml` recognises the columns, "
            "--guide asks for them"
        )
    inputs = [path for path in (*files, mapping_file, actuator_file) if path]
    written = _beside(output, ".yaml") if is_asked else None
    picture = _beside(output, ".png") if guide else None
    for path in filter(None, (output, written, picture)):
        require_free(path, inputs, overwrite=overwrite)
    mapping = load_mapping(mapping_file) if mapping_file else None
    if is_asked:
        source = open_input(files[0])
        if guide:
            for line in source.contents():
                click.echo(f"# {line}")
        mapping = mapping_of(source, described(actuator_file), entries, asks=guide)
    assert mapping is not None
    if written is not None:
        # Written before the data are checked, so that the answers are kept if they are refused.
        written.write_text(mapping_text(mapping), encoding="utf-8")
        click.echo(f"{written}: the mapping")
    sources = [open_input(file, mapping) for file in files]
    actuators = [
        read_records(sources, *actuator, accepts=accept_defects)
        for actuator in actuators_of(mapping, actuator_file)
    ]
    for file, imported in zip(files, actuators[0], strict=True):
        if imported.description != actuators[0][0].description:
            raise ValueError(
                f"{file} has a sample rate of {1.0 / imported.rate.period:g} Hz, but {files[0]} "
                f"has {1.0 / actuators[0][0].rate.period:g} Hz: expected equal rates; set "
                "clock.rate_hz in the mapping"
            )
    write_records(output, actuators, overwrite=overwrite)
    if picture is not None:
        _draw(output, picture)
        click.echo(f"{picture}: compare this picture with your record")
    for records in actuators:
        unit, h = records[0].description, records[0].description.sample_period
        samples = sum(len(run.stamps_ns) for record in records for run in record.runs)
        click.echo(
            f"{output}: {counted(samples, 'sample')} of {unit.actuator_id} "
            f"({unit.serial_number}) at {1.0 / h:g} Hz, {samples * h:.3f} s of telemetry"
        )
    if actuator_file is None and not mapping.joints:
        click.echo(
            "note: without --actuator, the bag has the description of the built-in actuator",
            err=True,
        )


def _beside(bag: Path, suffix: str) -> Path:
    return bag.with_name(bag.name.removesuffix(".mcap") + suffix)


def _draw(bag: Path, picture: Path) -> None:
    """Draw the telemetry of an imported bag as a picture."""
    from ema_cli.figures.files import save_picture
    from ema_cli.figures.telemetry import Outline, draw_telemetry

    outline = Outline()
    save_picture(draw_telemetry(read_windows(bag, ReadingOptions(), outline.add), outline), picture)
