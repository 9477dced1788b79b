"""``ema normal``: a unit's own normal, and what departs from it."""

import json
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from ema_cli.bags.named_tests import as_mapping, read_test
from ema_cli.options import REFUSED
from ema_cli.show.progress import progress_bar
from ema_core.wording import counted
from ema_monitor.normal.moves import MoveSeries, MoveVerdict
from ema_monitor.normal.unit_normal import HEALTHY, UnitNormal

_file = click.argument("file", type=click.Path(path_type=Path, dir_okay=False))
_bags = click.argument("bags", nargs=-1, required=True, type=click.Path(path_type=Path))
_actuator_id = click.option("--actuator-id", help="Which actuator, where a bag holds several.")
_condition = click.option(
    "--condition",
    default="",
    help='What has to be alike and is not in the telemetry, such as a load: "20 kg".',
)
_json = click.option("--json", "as_json", is_flag=True, help="Print JSON.")


@click.group()
def normal() -> None:
    """Learn how healthy tests of a unit scatter, and report whether a later one departs.

    No model and no calibration is needed, only the current and a repeated command. A bag is a test.
    `learn` adds tests to FILE, healthy ones or such whose state is known; `check` judges later
    ones; `moves` does so where a drive logs no samples, only figures of each move.
    """


@normal.command()
@_file
@_bags
@click.option("--state", default=HEALTHY, show_default=True, help="State of the unit in the tests.")
@_condition
@_actuator_id
def learn(
    file: Path, bags: tuple[Path, ...], state: str, condition: str, actuator_id: str | None
) -> None:
    """Add each of BAGS to the tests in FILE, which is made where it is not there.

    Healthy tests on several days show what is usual between days. A bag that is there already takes
    its new state.
    """
    known = UnitNormal.load(file) if file.exists() else UnitNormal()
    with progress_bar() as progress:
        for bag in progress.track(bags, description="reading"):
            known.add(read_test(bag, actuator_id, state, condition))
    known.save(file)
    states: dict[str, int] = {}
    for test in known.tests:
        states[test.state] = states.get(test.state, 0) + 1
    click.echo(f"{file}: {', '.join(f'{count} {name}' for name, count in states.items())}")


@normal.command()
@_file
@_bags
@_condition
@_actuator_id
@_json
def check(
    file: Path, bags: tuple[Path, ...], condition: str, actuator_id: str | None, as_json: bool
) -> None:
    """Report of each of BAGS whether it departs from the healthy tests in FILE, and by what.

    Exit code 3 where one departs, or cannot be judged.
    """
    known = UnitNormal.load(file)
    with progress_bar() as progress:
        tests = [
            read_test(bag, actuator_id, "", condition)
            for bag in progress.track(bags, description="reading")
        ]
    found = [known.check(test) for test in tests]
    if as_json:
        click.echo(
            json.dumps(
                [{"bag": str(bag), **as_mapping(one)} for bag, one in zip(bags, found, strict=True)]
            )
        )
    else:
        for bag, one in zip(bags, found, strict=True):
            click.echo(f"{bag}: {one}")
    if any(one.departure is None or one.departed for one in found):
        raise click.exceptions.Exit(REFUSED)


@normal.command()
@click.argument("table", type=click.Path(path_type=Path, dir_okay=False, exists=True))
@click.option(
    "--mapping",
    "mapping_file",
    type=click.Path(path_type=Path),
    required=True,
    help="YAML file that names the columns (docs/inputs.md).",
)
@click.option("--limit", type=float, required=True, help="Ratio to healthy at which life ends.")
@click.option(
    "--reference", type=int, default=5, help="How many of the first tests are taken for healthy."
)
@_json
def moves(table: Path, mapping_file: Path, limit: float, reference: int, as_json: bool) -> None:
    """Judge each test in TABLE, a CSV or Parquet file with one row a move, by those before it.

    Exit code 3 where the last test of a unit departs or is beyond the limit.
    """
    from ema_bags.inputs.moves import load_moves_mapping, read_moves

    units = read_moves(table, load_moves_mapping(mapping_file))
    told = {}
    for unit, series in units.items():
        follow = MoveSeries(limit=limit, reference=reference)
        told[unit] = [(one, follow.add(one)) for one in series]
    if as_json:
        rows = [
            {
                "unit": unit,
                "stamp_ns": move.stamp_ns,
                "ratio": one.ratio,
                "level": one.level,
                "probability": one.probability,
                "life_days": None if one.life_days is None else list(one.life_days),
                "reason": one.reason,
            }
            for unit, series in told.items()
            for move, one in series
        ]
        click.echo(json.dumps(rows))
    else:
        for unit, series in told.items():
            _show(unit, [(move.stamp_ns, verdict) for move, verdict in series])
    if any(series[-1][1].level in ("WARN", "ERROR") for series in told.values() if series):
        raise click.exceptions.Exit(REFUSED)


def _show(unit: str, series: list[tuple[int, MoveVerdict]]) -> None:
    import pandas as pd

    title = f"{unit or 'unit'}: {counted(len(series), 'test')}"
    table = Table("time", "times healthy", "level", "life [d], 5 / 50 / 95 %", "why", title=title)
    for stamp_ns, one in series:
        life = " / ".join(f"{value:.1f}" for value in one.life_days or ())
        time = f"{pd.Timestamp(stamp_ns):%Y-%m-%d %H:%M}"
        table.add_row(time, f"{one.ratio:.2f}", one.level, life, one.reason)
    Console().print(table)
