"""``ema label``: the state of a unit in tests, by its owner."""

from dataclasses import replace
from pathlib import Path

import click

from ema_bags.windows import WindowsOnDemand
from ema_cli.bags.source import Source, identifiable_windows
from ema_cli.parameters import settings_options
from ema_core.wording import counted
from ema_monitor.calibrations import load_calibration
from ema_monitor.normal.normal import HEALTHY, NONE_OF_THESE


@click.command()
@click.argument("calibration_file", metavar="CALIBRATION", type=click.Path(path_type=Path))
@click.argument("bags", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--state", required=True, help='State of the unit in BAGS: "dry 1".')
@settings_options(Source)
def label(calibration_file: Path, bags: tuple[Path, ...], given: Source, state: str) -> None:
    """Add tests of a unit whose state is known, one in each of BAGS, to its CALIBRATION.

    A later test that departs from the healthy windows is then said to look like a state, with
    probabilities, or like none of them. A state needs three tests. A test that was labelled before
    takes the new state.
    """
    state = state.strip()
    if not state or state.lower() in (HEALTHY, NONE_OF_THESE):
        raise ValueError(
            f"--state {state!r}: expected what is wrong; `ema calibrate` takes all healthy bags "
            "together"
        )
    calibration = load_calibration(calibration_file)
    normal = calibration.normal
    for bag in bags:
        found = identifiable_windows(bag, given)
        if mismatch := calibration.unit_mismatch(found.description):
            raise ValueError(f"{bag}: {mismatch}")
        try:
            normal = normal.with_test(
                state, (one.telemetry for one in WindowsOnDemand(found.windows))
            )
        except ValueError as error:
            raise ValueError(f"{bag}: {error}") from error
    replace(calibration, normal=normal).save(calibration_file)
    tests = [f"{counted(count, 'test')} {name}" for name, count in normal.tests().items()]
    click.echo(f"{calibration_file}: {', '.join(tests)}")
