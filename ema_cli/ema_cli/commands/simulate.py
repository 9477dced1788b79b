# SPDX-License-Identifier: Apache-2.0
"""``ema simulate``: simulate a faulty actuator and record it to a bag."""

from pathlib import Path

import click

from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_cli.options import assignments_option, values_of_options
from ema_cli.output import BAG_TO_WRITE, new_bag, output_option, start_option
from ema_cli.parameters import settings_options
from ema_cli.processes.stop_request import deferred_signals
from ema_cli.progress import progress_bar
from ema_cli.rig_settings import COMMAND_OPTION, RigSettings
from ema_core.cause_profiles import GRAMMAR
from ema_core.faults import FAULT_NAMES
from ema_core.wording import counted
from ema_sim.bench import ActuatorBench


@click.command()
@assignments_option("--fault", "faults", f"Fault from 0 to 1: {', '.join(FAULT_NAMES)}.")
@click.option(
    "--cause",
    "causes",
    multiple=True,
    metavar=GRAMMAR,
    help=(
        "Hidden cause (docs/faults.md), e.g. load_torque=0.01, current_offset=0.1@3.0 (from 3 s "
        "on) or winding_temperature=80@0..10 (a ramp)."
    ),
)
@click.option("--cycles", default=1, type=click.IntRange(1, 100_000), help="Test cycles.")
@start_option("UTC time of the first cycle; use a different time for each bag")
@settings_options(RigSettings, "actuator", more=[COMMAND_OPTION])
@output_option(BAG_TO_WRITE)
def simulate(
    options: RigSettings,
    faults: dict[str, float],
    causes: tuple[str, ...],
    cycles: int,
    start_ns: int,
    overwrite: bool,
    output: Path,
) -> None:
    """Run the high-fidelity actuator through test cycles and record them to a bag.

    A cycle is a slow approach from below, the command, the return and a rest.
    """
    description = options.description
    with values_of_options():
        bench = ActuatorBench(
            description,
            options.settings,
            parameters=options.parameters,
            resolutions=options.resolutions,
            causes=causes,
        )
        bench.set_command(options.command)
        bench.set_faults(faults)
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
                task, total=cycles * cycle.samples, state=f"cycle {cycle.number + 1} of {cycles}"
            )
            recording.begin_cycle(cycle.number, cycle.faults, cycle.hours)
            for block, torque in cycle.blocks:
                if stop:
                    whole = f"{cycle.number} of {counted(cycles, 'cycle')}"
                    raise ValueError(f"stopped: {output} has {whole} and an incomplete one")
                recording.write_block(block, torque)
                progress.advance(task, len(block))
    seconds = 1e-9 * (bench.end_ns - start_ns)
    click.echo(
        f"{output}: {counted(cycles, 'cycle')} of {description.actuator_id} "
        f"({description.serial_number}), {seconds:.1f} s of telemetry"
    )
