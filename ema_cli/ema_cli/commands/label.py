"""``ema label``: the state of a unit in tests, by its owner."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path

import click

from ema_bags.windows import WindowsOnDemand
from ema_cli.bags.source import Source, identifiable_windows
from ema_cli.parameters import settings_options
from ema_core.wording import counted
from ema_monitor.calibrations import AnyCalibration, load_calibration
from ema_monitor.normal.features import Part, figures_of
from ema_monitor.normal.normal import HEALTHY, NONE_OF_THESE
from ema_monitor.normal.unit_normal import UnitNormal
from ema_monitor.prognosis.history import read_history

_HEALTHY = (HEALTHY, "normal", "nan", "none", "")


@click.command()
@click.argument("calibration_file", metavar="CALIBRATION", type=click.Path(path_type=Path))
@click.argument("bags", nargs=-1, type=click.Path(path_type=Path))
@click.option("--state", help='State of the unit in BAGS: "dry 1".')
@click.option(
    "--state-column",
    metavar="COLUMN",
    help="BAGS are tables, and this column has the state; healthy rows are left out.",
)
@click.option(
    "--test-column",
    "test_columns",
    metavar="COLUMN",
    multiple=True,
    help="With --state-column: a test ends where this column changes, too.",
)
@click.option(
    "--test",
    "chosen",
    metavar="NUMBER|DATE",
    multiple=True,
    help="With a history: a test by its number from 1, or tests by (the beginning of) UTC time.",
)
@click.option("--remove", metavar="STATE", help="Remove the tests of a state.")
@settings_options(Source)
def label(
    calibration_file: Path,
    bags: tuple[Path, ...],
    given: Source,
    state: str | None,
    state_column: str | None,
    test_columns: tuple[str, ...],
    chosen: tuple[str, ...],
    remove: str | None,
) -> None:
    """Add tests of a unit whose state is known, one in each of BAGS, to its CALIBRATION.

    A later test is then said to look like a state or like healthy ones, with probabilities, or
    like none of them. A state needs three tests. A test that was labelled before takes the new
    state. Without BAGS the states are listed. A history of the unit, ACTUATOR+SERIAL.sqlite, takes
    the place of the bags of its tests.
    """
    if bool(bags) != ((state is None) != (state_column is None)):
        raise click.UsageError("give BAGS with either --state or --state-column")
    calibration = load_calibration(calibration_file)
    normal = calibration.normal
    if remove is not None:
        normal = normal.without(remove)
    for bag in bags:
        tests = [(state or "", bag)]
        if state_column is not None:
            tests = _tests_of(bag, [state_column, *test_columns], given)
        for name, part in tests:
            if part.suffix == ".sqlite":
                stretches = _of_history(part, chosen, calibration)
            elif chosen:
                raise click.UsageError("--test goes with a history, ACTUATOR+SERIAL.sqlite")
            else:
                own = given if part == bag else replace(given, actuator_file=None)
                stretches = [_of_bag(bag, part, own, calibration)]
            for test in stretches:
                normal = _with_test(normal, name, bag, *test)
    if normal is not calibration.normal:
        replace(calibration, normal=normal).save(calibration_file)
    tests = [f"{counted(count, 'test')} {name}" for name, count in normal.tests().items()]
    click.echo(f"{calibration_file}: {', '.join(tests) or 'no healthy windows to compare with'}")


def _tests_of(table: Path, columns: list[str], given: Source) -> Iterator[tuple[str, Path]]:
    """Yield the state of each test in a table, and its bag; healthy ones are left out."""
    from ema_cli.bags.records import tables_as_bags  # pandas only where there is a table

    for (state, *_), bag in tables_as_bags(table, given.actuator_file, columns):
        if state.strip().lower() not in _HEALTHY:
            yield state, bag


def _of_bag(
    path: Path, bag: Path, given: Source, calibration: AnyCalibration
) -> tuple[int, list[Part]]:
    """Return stamp [ns] and stretches of the test in a bag, which is of a path."""
    found = identifiable_windows(bag, given)
    if mismatch := calibration.unit_mismatch(found.description):
        raise ValueError(f"{path}: {mismatch}")
    stretches = (figures_of(one.telemetry) for one in WindowsOnDemand(found.windows))
    return found.first_ns, list(chain.from_iterable(stretches))


def _of_history(
    path: Path, chosen: tuple[str, ...], calibration: AnyCalibration
) -> Iterator[tuple[int, Sequence[Part]]]:
    """Yield stamps [ns] and stretches of tests in a history."""
    history = read_history(path)
    if history.unit != (calibration.actuator_id, calibration.serial_number):
        raise ValueError(f"{path} is of {history.unit}, another unit than the calibration's")
    tests = history.tests
    dates = [f"{datetime.fromtimestamp(1e-9 * one.stamp_ns, UTC):%FT%T}" for one in tests]
    for one in chosen or [""]:
        found = [
            test
            for number, (date, test) in enumerate(zip(dates, tests, strict=True), 1)
            if one == str(number) or ("-" in one and date.startswith(one))
        ]
        if not found:
            last = f"its last, {len(tests)}, is of {dates[-1]}" if tests else "it has none"
            raise ValueError(f"{path}: --test {one!r}: expected number or date of a test; {last}")
        yield from ((test.stamp_ns, test.parts) for test in found)


def _with_test(
    normal: UnitNormal, state: str, path: Path, stamp_ns: int, parts: Sequence[Part]
) -> UnitNormal:
    """Return a normal with a test, which is of a path."""
    state = state.strip()
    if state.lower() in (*_HEALTHY, NONE_OF_THESE):
        words = "expected what is wrong; `ema calibrate` takes all healthy bags together"
        raise ValueError(f"state {state!r}: {words}")
    try:
        return normal.with_test(state, stamp_ns, parts)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
