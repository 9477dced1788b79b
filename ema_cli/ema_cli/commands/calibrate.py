# SPDX-License-Identifier: Apache-2.0
"""``ema calibrate``: calibrate an actuator from healthy bags."""

import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import click

from ema_cli.bags.reading import (
    MEASURED_OPTION,
    ReadingOptions,
    accept_option,
    differing,
    identifiable_windows,
)
from ema_cli.options import REFUSED
from ema_cli.output import output_option, require_free
from ema_cli.parameters import settings_options
from ema_cli.progress import progress_bar
from ema_core.description import ActuatorDescription
from ema_core.wording import counted
from ema_monitor import calibrations
from ema_monitor.calibration.joint_calibration import JointCalibration
from ema_monitor.calibrations import AnyCalibration
from ema_monitor.identification.joint_estimate import comparable_record
from ema_monitor.joint.wording import baseline_sentences
from ema_monitor.model.measured import measured_ranges
from ema_monitor.reason_texts import joined
from ema_monitor.recordings.windows import RecordedWindow, WindowsOnDemand
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

_ENOUGH_WINDOWS = 5


@click.command()
@click.argument("bags", nargs=-1, required=True, type=click.Path(path_type=Path))
@settings_options(
    ReadingOptions,
    more=[
        accept_option(
            "Use --actuator although it contradicts a bag, and bags with simulated faults."
        ),
        MEASURED_OPTION,
    ],
)
@output_option("Calibration file to write", dir_okay=False)
@click.option(
    "--accepted-by",
    metavar="NAME",
    default="",
    help=(
        "Name of the person who accepts a unit with implausible parameters; without a name, the "
        "unit is refused."
    ),
)
def calibrate(
    bags: tuple[Path, ...], options: ReadingOptions, overwrite: bool, output: Path, accepted_by: str
) -> None:
    """Calibrate with the windows or records in BAGS of one healthy actuator.

    Measured hidden causes, such as a load, are used with their sigma; they come from the bags or
    --measured. Parameters that the windows do not determine are listed at the end.

    Four or more records of an unknown drive are compared with each other. A record that differs
    from the rest is still used, but is reported in a warning and in the calibration. Days are UTC
    days: a session across midnight UTC counts as two days.

    Exit code 3: a bag records simulated faults, so that its unit is not healthy.
    """
    read = [*bags, *([options.actuator_file] if options.actuator_file else [])]
    require_free(output, read, overwrite=overwrite)
    descriptions, windows = [], []
    names: list[str] = []
    for bag in bags:
        bag_windows = identifiable_windows(bag, options)
        for item in bag_windows.windows:
            if isinstance(item.place, Refusal):
                click.echo(f"{bag}: a window is skipped: {item.place.reason}", err=True)
        windows += bag_windows.windows
        names += _names(bag, bag_windows.windows)
        descriptions.append(bag_windows.description)
        _require_same(bags[0], descriptions[0], bag, bag_windows.description)
        if bag_windows.simulated_faults:
            words = f"{bag} records simulated faults: the unit is not healthy"
            if not options.accept_defects:
                accept = "use --accept-defects to calibrate anyway"
                click.echo(f"Error: {words}; {accept}", err=True)
                sys.exit(REFUSED)
            click.echo(f"warning: {words}", err=True)
    with progress_bar() as progress:
        progress.add_task("calibrating", total=None)
        calibration = calibrations.calibrate(
            WindowsOnDemand(windows), descriptions[0], accepted_by=accepted_by
        )
    calibration = _with_labels(calibration, output)
    calibration.save(output)
    used = [window.measured for window in windows if not isinstance(window.place, Refusal)]
    if measured := measured_ranges(used):
        click.echo(f"measured causes: {measured}")
    click.echo(f"{output}: {calibration}")
    if isinstance(calibration, JointCalibration):
        click.echo("\n".join(baseline_sentences(calibration.comparer)))
        for remark in _remarks(windows, names, calibration):
            click.echo(f"warning: {remark}", err=True)
    elif calibration.windows < _ENOUGH_WINDOWS:
        windows = counted(calibration.windows, "window")
        click.echo(
            f"warning: {windows} average out little of the current ripple: use at least "
            f"{_ENOUGH_WINDOWS}",
            err=True,
        )


def _require_same(
    first: Path, expected: ActuatorDescription, bag: Path, described: ActuatorDescription
) -> None:
    """Raise ``ValueError`` with the differences if two bags belong to different actuators.

    Records of an unknown drive may differ in sample rate, because they are filtered to the same
    band.
    """
    same = described
    if not (expected.is_modelled or described.is_modelled):
        same = replace(described, sample_period=expected.sample_period)
    if differences := "; ".join(differing(expected, same, str(first), str(bag))):
        raise ValueError(
            f"{bag} and {first} are from different actuators: {differences}. Calibrate with "
            "files of one actuator and one description"
        )


def _names(bag: Path, windows: Sequence[RecordedWindow]) -> list[str]:
    """Return a name for each window: the bag, with a number if the bag has several windows."""
    several = len(windows) > 1
    return [f"record {item.number} of {bag}" if several else str(bag) for item in windows]


def _remarks(
    windows: Sequence[RecordedWindow], names: Sequence[str], calibration: JointCalibration
) -> Iterator[str]:
    """Yield remarks about unused records and about records that differ from the rest."""
    used: list[str] = []
    stamps = Counter(item.start_ns for item in windows)
    of_records = {record.stamp_ns for record in calibration.baseline.records}
    for item, name in zip(windows, names, strict=True):
        # Files without dates may have equal timestamps.
        if item.start_ns in of_records and stamps[item.start_ns] == 1:
            used.append(name)
        elif isinstance(window := item.window, Window):
            record = comparable_record(window, item.description, calibration)
            if isinstance(record, tuple):
                yield f"{name} is not used: {joined(record)}"
            else:
                used.append(name)
    is_complete = len(used) == calibration.windows
    for outlier in calibration.outliers:
        yield f"{used[outlier.number]} {outlier.remark}" if is_complete else str(outlier)


def _with_labels(calibration: AnyCalibration, output: Path) -> AnyCalibration:
    """Return a calibration with the labels of the calibration that it replaces in ``output``."""
    if not output.exists():
        return calibration
    try:
        replaced = calibrations.load_calibration(output)
    except ValueError as error:
        click.echo(f"warning: its labels, if any, are lost: {error}", err=True)
        return calibration
    kept = calibrations.with_labels_of(calibration, replaced)
    if lost := replaced.baseline.states().keys() - kept.baseline.states().keys():
        words = (
            "labels dropped, because they belong to another unit or a motion without healthy "
            "windows"
        )
        click.echo(f"warning: {words}: {', '.join(sorted(lost))}", err=True)
    if labels := kept.baseline.states().keys() - calibration.baseline.states().keys():
        click.echo(f"labelled states kept: {', '.join(sorted(labels))}")
    return kept
