# SPDX-License-Identifier: Apache-2.0
"""``ema label``: label tests of a unit with the state that it was in."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click

from ema_bags.recording import Recording
from ema_cli.bags.reading import ReadingOptions, accept_option, identifiable_windows
from ema_cli.parameters import settings_options
from ema_core.wording import counted
from ema_monitor.calibration.joint_calibration import JointCalibration
from ema_monitor.calibrations import AnyCalibration, load_calibration
from ema_monitor.identification.joint_estimate import comparable_record
from ema_monitor.joint.departure import HEALTHY, NONE_OF_THESE
from ema_monitor.joint.record import JointRecord
from ema_monitor.joint.window_figures import WindowFigures, figures_of
from ema_monitor.prognosis.history import read_history
from ema_monitor.reason_texts import differences_text, joined
from ema_monitor.recordings.windows import WindowsOnDemand
from ema_monitor.windows.trigger import Refusal

_HEALTHY = (HEALTHY, "normal", "nan", "none", "")

_Test = tuple[int, tuple[WindowFigures, ...]]
"""Timestamp of a test [ns] and features of its windows."""


@click.command()
@click.argument("calibration_file", metavar="CALIBRATION", type=click.Path(path_type=Path))
@click.argument("bags", nargs=-1, type=click.Path(path_type=Path))
@click.option("--state", help='State of the unit in BAGS, such as "dry 1".')
@click.option(
    "--state-column",
    metavar="COLUMN",
    help="Column of the state, if BAGS are tables; healthy rows are skipped.",
)
@click.option(
    "--test-column",
    "test_columns",
    metavar="COLUMN",
    multiple=True,
    help="With --state-column: a test also ends where this column changes.",
)
@click.option(
    "--test",
    "chosen",
    metavar="NUMBER|DATE",
    multiple=True,
    help="With a history: test to label, by number (from 1) or UTC date or time (2026-11-30T14).",
)
@click.option("--remove", metavar="STATE", help="Remove the tests of a state.")
@settings_options(ReadingOptions, more=[accept_option()])
def label(
    calibration_file: Path,
    bags: tuple[Path, ...],
    options: ReadingOptions,
    state: str | None,
    state_column: str | None,
    test_columns: tuple[str, ...],
    chosen: tuple[str, ...],
    remove: str | None,
) -> None:
    """Add tests of a unit in a known state, one per bag, to its CALIBRATION.

    Later estimates then include the probability of each labelled state, of the healthy state, and
    of any other state. A state requires three tests. A new label replaces the previous label of a
    test. Without BAGS, the command lists the states. For an unknown drive, a test is a record. For
    other drives, a history of the unit, ACTUATOR+SERIAL.sqlite, can replace the bags.
    """
    if bool(bags) != ((state is None) != (state_column is None)):
        raise click.UsageError("expected BAGS with either --state or --state-column")
    calibration = load_calibration(calibration_file)
    labelled = calibration
    if remove is not None:
        labelled = _with_baseline(labelled, labelled.baseline.without(remove))
    for bag in bags:
        tests: Iterable[tuple[str, Recording | None]] = [(state or "", None)]
        if state_column is not None:
            tests = _tests_of(bag, [state_column, *test_columns], options)
        for name, part in tests:
            name = _checked(name)
            try:
                if part is None and bag.suffix == ".sqlite":
                    labelled = _with_history(labelled, name, bag, chosen)
                elif chosen:
                    raise click.UsageError("--test requires a history, ACTUATOR+SERIAL.sqlite")
                else:
                    part_options = options if part is None else replace(options, actuator_file=None)
                    labelled = _with_bag(labelled, name, bag, part_options, part)
            except ValueError as error:
                raise ValueError(f"{bag}: {error}") from error
    if labelled is not calibration:
        labelled.save(calibration_file)
    noun = "record" if isinstance(labelled, JointCalibration) else "test"
    states = labelled.baseline.states().items()
    counts = [f"{counted(count, noun)} {name}" for name, count in states]
    click.echo(f"{calibration_file}: {', '.join(counts) or 'no healthy windows for comparison'}")


def _tests_of(
    table: Path, columns: list[str], options: ReadingOptions
) -> Iterator[tuple[str, Recording]]:
    """Yield state and recording of each test in a table, skipping healthy tests."""
    from ema_cli.bags.records import table_recordings  # imported only for tables

    for (state, *_), recording in table_recordings(table, options.actuator_file, columns):
        if state.strip().lower() not in _HEALTHY:
            yield state, recording


def _checked(state: str) -> str:
    """Return the name of a state without surrounding blanks.

    Raises
    ------
    ValueError
        If the name denotes a healthy or an unlabelled state.
    """
    name = state.strip()
    if name.lower() in (*_HEALTHY, NONE_OF_THESE):
        raise ValueError(
            f"state {name!r}: expected the name of a fault; use `ema calibrate` for healthy bags"
        )
    return name


def _with_bag(
    calibration: AnyCalibration,
    state: str,
    bag: Path,
    options: ReadingOptions,
    part: Recording | None,
) -> AnyCalibration:
    """Return the calibration with the tests of a bag, or a part of a table, added to a state.

    Raises
    ------
    ValueError
        If the bag belongs to another unit, or no window or record of it can be used.
    """
    bag_windows = identifiable_windows(bag, options, part)
    if mismatch := calibration.unit_mismatch(bag_windows.description):
        raise ValueError(differences_text(mismatch))
    windows = WindowsOnDemand(bag_windows.windows)
    if not isinstance(calibration, JointCalibration):
        figures = [item for window in windows for item in figures_of(window.telemetry)]
        baseline = calibration.baseline.with_test(state, bag_windows.first_ns, figures)
        return _with_baseline(calibration, baseline)
    baseline, reasons = calibration.baseline, list[str]()
    for window in windows:
        record = comparable_record(window, bag_windows.description, calibration)
        if isinstance(record, JointRecord):
            baseline = baseline.with_record(state, record)
        else:
            reasons.append(joined(record))
    if baseline is calibration.baseline:
        why = reasons or [
            window.place.reason
            for window in bag_windows.windows
            if isinstance(window.place, Refusal)
        ]
        raise ValueError(f"no record can be labelled: {'; '.join(dict.fromkeys(why))}")
    for reason in reasons:
        click.echo(f"{bag}: a record is skipped: {reason}", err=True)
    return _with_baseline(calibration, baseline)


def _with_history(
    calibration: AnyCalibration, state: str, path: Path, chosen: tuple[str, ...]
) -> AnyCalibration:
    """Return the calibration with tests of a history added to a state.

    ``chosen`` and errors are as in ``_of_history``; ValueError also for an unknown drive.
    """
    if isinstance(calibration, JointCalibration):
        raise ValueError("histories do not contain the features of records; label the bags instead")
    baseline = calibration.baseline
    for test in _of_history(path, chosen, calibration):
        baseline = baseline.with_test(state, *test)
    return _with_baseline(calibration, baseline)


def _of_history(
    path: Path, chosen: tuple[str, ...], calibration: AnyCalibration
) -> Iterator[_Test]:
    """Yield the tests of a history that ``chosen`` selects by number (from 1) or date.

    Raises
    ------
    ValueError
        If the history belongs to another unit, nothing is chosen, or an item selects no test. The
        message has the number and date of the last test.
    """
    history = read_history(path)
    if history.unit != (calibration.actuator_id, calibration.serial_number):
        raise ValueError(
            f"the history belongs to {history.unit}, but the calibration to "
            f"{calibration.actuator_id} ({calibration.serial_number})"
        )
    tests = history.tests
    dates = [f"{datetime.fromtimestamp(1e-9 * test.stamp_ns, UTC):%FT%T}" for test in tests]
    last = (
        f"the last test, number {len(tests)}, has the date {dates[-1]}"
        if tests
        else "the history has no tests"
    )
    if not chosen:
        raise ValueError(
            f"select the tests of this state with --test NUMBER or --test DATE; {last}"
        )
    for item in chosen:
        matching = [
            test
            for number, (date, test) in enumerate(zip(dates, tests, strict=True), 1)
            if item == str(number) or ("-" in item and date.startswith(item))
        ]
        if not matching:
            raise ValueError(f"--test {item!r}: expected number or date of a test; {last}")
        yield from ((test.stamp_ns, test.parts) for test in matching)


def _with_baseline(calibration: AnyCalibration, baseline: Any) -> AnyCalibration:
    return replace(calibration, baseline=baseline)
