"""``ema learn``: how the units of a fleet grow, from their histories."""

from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from ema_cli.bags.output_path import require_free
from ema_cli.bags.predicting import LIMIT_OPTION, with_growth
from ema_cli.errors import one_clear_line
from ema_cli.parameters import Parameters
from ema_cli.show.progress import progress_bar
from ema_core.wording import counted
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.fleet import SUFFIX, Fleet, fleet_of
from ema_monitor.prognosis.growth.fleet import grid_digest
from ema_monitor.prognosis.history import read_history
from ema_monitor.prognosis.sentences import label_of


@click.command()
@click.argument(
    "histories",
    metavar="HISTORY...",
    nargs=-1,
    required=True,
    type=click.Path(path_type=Path, exists=True),
)
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    help=f"File to write; its name ends in {SUFFIX}.",
)
@click.option("--name", default="", help='What the fleet is called, as in "A320 flaps".')
@LIMIT_OPTION
@click.option("--replace", "overwrite", is_flag=True, help="Replace an existing file.")
def learn(
    histories: tuple[Path, ...],
    output: Path,
    name: str,
    limits: tuple[list[tuple[str, float]], ...],
    overwrite: bool,
) -> None:
    """Learn how the units of a fleet grow, from the HISTORY of each.

    HISTORY is a file ACTUATOR+SERIAL.sqlite of a monitor, a folder of them, or what this command
    wrote at another site: it holds no test and no serial number, and a unit that is in two of them
    counts once. `ema prognose --fleet` and the monitor's parameter fleet_file use the result.
    """
    with one_clear_line():
        if output.suffix != SUFFIX:
            raise ValueError(f"{output}: expected a name that ends in {SUFFIX}")
        require_free(output, histories, overwrite=overwrite)
        chosen = with_growth(Parameters({}), limits).over(HealthLimits(), "limits.")
        fleet = Fleet(grid_digest(chosen))
        files = [file for path in histories for file in _files(path)]
        with progress_bar() as progress:
            for file in progress.track(files, description="reading"):
                if file.suffix == SUFFIX:
                    fleet = fleet.together(Fleet.read(file))
                else:
                    fleet = fleet.together(fleet_of([read_history(file)], chosen))
        if name:
            fleet = Fleet(fleet.grid, fleet.units, frozenset([name]))
        prior = fleet.prior(chosen)
        fleet.write(output)
    table = Table("fault", "units that show its growth")
    for kind, count in sorted(prior.counts.items()):
        table.add_row(label_of(kind), str(count))
    if prior.counts:
        Console().print(table)
    grown = f"{prior.units} of them with a fault that grows"
    click.echo(f"{output}: {counted(len(fleet.units), 'unit')}, {grown}")


def _files(path: Path) -> list[Path]:
    """Return a file, or the histories of a folder."""
    if not path.is_dir():
        return [path]
    found = sorted(path.glob("*+*.sqlite"))
    if not found:
        raise ValueError(f"{path}: no file ACTUATOR+SERIAL.sqlite in the folder")
    return found
