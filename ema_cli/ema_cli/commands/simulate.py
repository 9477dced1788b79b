"""``ema simulate``: a faulty actuator to a bag."""

from pathlib import Path
from typing import Final

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Column, Table

from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_cli.bench import COMMAND_OPTION, Bench
from ema_cli.errors import Assignments, merged, one_clear_line
from ema_cli.new_bag import START_OPTION, new_bag
from ema_cli.parameters import settings_options
from ema_cli.processes.stop_request import deferred_signals
from ema_cli.show.progress import progress_bar
from ema_core.cause_profiles import GRAMMAR, describe_causes
from ema_core.faults import FAULT_NAMES, FAULTS, random_faults
from ema_core.wording import as_identifier, counted
from ema_sim.bench import ActuatorBench

_STREAM_OF_FAULTS: Final = 1_000_000  # beyond those that the bench spawns of the same seed


@click.command()
@click.option(
    "--fault",
    "faults",
    type=Assignments(as_identifier),
    multiple=True,
    help=f"A fault in [0, 1], e.g. friction=0.25; known: {', '.join(FAULT_NAMES)}.",
)
@click.option(
    "--cause",
    "causes",
    multiple=True,
    metavar=GRAMMAR,
    help="A hidden cause that is none of the faults, e.g. load_torque=0.01, "
    "current_offset=0.1@3.0 (from 3 s on) or winding_temperature=80@0..10 (a ramp); "
    f"known, with unit and range: {describe_causes()}.",
)
@click.option(
    "--random-faults",
    "draws_faults",
    is_flag=True,
    help="Draw a multiple fault by the law of the thesis, most of it small, from --seed.",
)
@click.option("--cycles", default=1, type=click.IntRange(1, 100_000))
@START_OPTION
@settings_options(Bench, "actuator", more=[COMMAND_OPTION])
@click.option("--replace", "overwrite", is_flag=True, help="Replace an existing bag.")
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    help="Bag to write: one file if it ends in .mcap, else a folder.",
)
def simulate(
    given: Bench,
    faults: tuple[list[tuple[str, float]], ...],
    causes: tuple[str, ...],
    draws_faults: bool,
    cycles: int,
    start_ns: int,
    overwrite: bool,
    output: Path,
) -> None:
    """Run the high-fidelity actuator through test cycles and record them to a bag.

    Every cycle approaches its start slowly from below, so that the gear always rests on the same
    flank, runs the command, returns and rests.
    """
    if draws_faults and faults:
        raise click.UsageError("--random-faults and --fault exclude each other")
    with one_clear_line():
        description, seed = given.description, given.settings.seed
        bench = ActuatorBench(
            description,
            given.settings,
            parameters=given.parameters,
            resolutions=given.resolutions,
            causes=causes,
        )
        bench.set_command(given.command)
        drawn = _drawn_faults(seed) if draws_faults else None
        bench.set_faults(merged(faults, "--fault") if drawn is None else drawn)
        with (
            deferred_signals() as stop,
            new_bag(output, overwrite=overwrite) as bag,
            SimulatedActuatorBag(bag, description, start_ns) as recording,
            progress_bar() as progress,
        ):
            recording.note_causes(bench.causes)
            task = progress.add_task("simulating", total=None)
            bench.end_ns = start_ns
            for _ in range(cycles):
                cycle = bench.begin_cycle()
                progress.update(
                    task,
                    total=cycles * cycle.samples,
                    state=f"cycle {cycle.number + 1} of {cycles}",
                )
                recording.begin_cycle(cycle.number, cycle.faults, cycle.hours)
                for block, torque in cycle.blocks:
                    if stop:
                        raise click.Abort
                    recording.write_block(block, torque)
                    progress.advance(task, len(block))
    if drawn is not None:
        _print_drawn(drawn, seed)
    seconds = 1e-9 * (bench.end_ns - start_ns)
    click.echo(
        f"{output}: {counted(cycles, 'cycle')} of {description.actuator_id} "
        f"({description.serial_number}), {seconds:.1f} s of telemetry"
    )


def _drawn_faults(seed: int) -> NDArray[np.float64]:
    """Return a random fault vector, ``(8,)``, that has nothing to do with the noise."""
    stream = np.random.SeedSequence(seed, spawn_key=(_STREAM_OF_FAULTS,))
    return random_faults(np.random.default_rng(stream))


def _print_drawn(faults: NDArray[np.float64], seed: int) -> None:
    k = Column("k", justify="right")
    title = f"true faults, drawn with seed {seed}"
    table = Table("fault", k, "which means", title=title, title_justify="left")
    for fault, value in zip(FAULTS, faults, strict=True):
        table.add_row(fault.name, f"{value:.6f}", fault.physical(value))
    Console().print(table)
