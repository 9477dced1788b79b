# SPDX-License-Identifier: Apache-2.0
"""``ema learn-fleet``: learn fault growth in a fleet from unit histories."""

from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from ema_cli.bags.predicting import FAULT_LIMITS, with_growth
from ema_cli.options import assignments_option
from ema_cli.output import output_option, require_free
from ema_cli.parameters import Parameters
from ema_cli.progress import progress_bar
from ema_core.labels import label_of
from ema_core.wording import counted
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.fleet_growth import SUFFIX, FleetGrowth, fleet_of
from ema_monitor.prognosis.growth.fleet_prior import grid_digest
from ema_monitor.prognosis.history import read_history


@click.command()
@click.argument(
    "histories",
    metavar="HISTORY...",
    nargs=-1,
    required=True,
    type=click.Path(path_type=Path, exists=True),
)
@output_option(f"File to write; its name ends in {SUFFIX}")
@click.option("--name", default="", help='Name of the fleet, such as "A320 flaps".')
@assignments_option("--limit", "limits", "End-of-life limit of a fault: friction=0.4.")
def learn_fleet(
    histories: tuple[Path, ...], output: Path, name: str, limits: dict[str, float], overwrite: bool
) -> None:
    """Learn the fault growth of a fleet from the HISTORY of each unit.

    HISTORY is a monitor's file ACTUATOR+SERIAL.sqlite, a folder of such files, or the output of
    this command at another site. The output contains no tests and no serial numbers; a unit in
    several inputs counts once. `ema predict --fleet` and the monitor's parameter fleet_file use the
    output.
    """
    require_free(output, histories, overwrite=overwrite, endings=[SUFFIX])
    parameters = with_growth(Parameters({}), limits, limited=FAULT_LIMITS)
    chosen = parameters.over(HealthLimits(), "limits.")
    fleet = FleetGrowth(grid_digest(chosen))
    files = []
    for path in histories:
        paths = sorted(path.glob("*+*.sqlite")) if path.is_dir() else [path]
        if not paths:
            raise ValueError(
                f"{path} has no file ACTUATOR+SERIAL.sqlite: expected a history_folder"
            )
        files += paths
    with progress_bar() as progress:
        for file in progress.track(files, description="reading"):
            is_fleet = file.suffix == SUFFIX
            added = FleetGrowth.read(file) if is_fleet else fleet_of([read_history(file)], chosen)
            fleet = fleet.together(added)
        if name:
            fleet = FleetGrowth(fleet.grid, fleet.units, frozenset([name]))
        progress.add_task("learning", total=None)
        prior = fleet.prior(chosen)
    fleet.write(output)
    table = Table("fault", "units with significant growth")
    for kind, count in sorted(prior.counts.items()):
        table.add_row(label_of(kind), str(count))
    if prior.counts:
        Console().print(table)
    grown = f"{prior.units} with a growing fault"
    click.echo(f"{output}: {counted(len(fleet.units), 'unit')}, {grown}")
