# SPDX-License-Identifier: Apache-2.0
"""The ``ema`` command."""

from importlib import import_module
from keyword import iskeyword
from typing import Final

import click

from ema_core import __version__
from ema_core.start import quiet_imports

_GROUPS: Final = {
    "Simulate": {
        "simulate": "Run the high-fidelity actuator through test cycles and record them to a bag.",
        "lives": "Simulate lives of actuators, test by test, until a fault reaches its limit.",
        "certify": "Predict which faults a test detects, how well, and which it cannot separate.",
        "design": "Find the shortest test command that reaches a target accuracy within limits.",
    },
    "Import": {
        "check": "Recognise the columns of each joint in SOURCE, and report defects.",
        "new-actuator": "Write an actuator file from the values in a data sheet.",
        "import": "Convert third-party telemetry in each FILE to a bag for the other commands.",
        "info": "Show the content of BAG: topics, actuator, telemetry, windows, and defects.",
        "recover": "Copy the intact part of a damaged BAG to a new bag with an index.",
    },
    "Calibrate": {
        "calibrate": "Calibrate with the windows or records in BAGS of one healthy actuator.",
        "label": "Add tests of a unit in a known state, one per bag, to its CALIBRATION.",
        "baseline": "List, show, accept, extend and reset the learned baselines of joints.",
    },
    "Diagnose": {
        "estimate": "Estimate the faults in each window of BAG, with their uncertainty.",
        "moves": "Compare each test in TABLE (CSV or Parquet, a row per move) with earlier tests.",
        "verify": "Recompute recorded estimates from the recorded telemetry, and compare both.",
        "plot": "Draw the telemetry of BAG with its windows; with --window, also fit and faults.",
    },
    "Predict": {
        "predict": "Predict the remaining life of a unit from tests in bags or folders of bags.",
        "learn-fleet": "Learn the fault growth of a fleet from the HISTORY of each unit.",
        "report": "Write a report on a unit from the tests in bags, or folders of bags.",
    },
    "Live": {
        "attach": "Monitor the joints of robots in the ROS graph until Ctrl-C, or of RECORDINGS.",
        "up": "Run nodes until Ctrl-C; by default simulated actuator, monitor and dashboard.",
        "watch": "Show the health of all actuators, worst first, until Ctrl-C.",
        "record": "Record telemetry, estimates and health until Ctrl-C.",
        "play": "Play BAG, and publish its time on /clock.",
        "demo": "Watch a simulated actuator wear out, on the terminal and on the dashboard.",
    },
    "Archive": {
        "archive": "Store results of a fleet's bags in tables: estimates, health, life and growth."
    },
    "Study": {
        "thesis": "Repeat the thesis's study of ten single faults and a multiple fault.",
        "compare": "Compare algorithms on one window of BAG: faults, accuracy and computing time.",
    },
    "Shell": {"completion": "Print the shell completion script for SHELL."},
}
"""Help summaries of the commands, keyed by group and name; `ema --help` imports no command."""

_COMMANDS: Final = {name: text for group in _GROUPS.values() for name, text in group.items()}
"""Help summaries, keyed by name, in the order of the help."""

_EXAMPLES: Final = {
    "simulate": "--fault friction=0.25 -o dry.mcap",
    "lives": "--count 3 -o fleet",
    "import": "log.csv --mapping mapping.yaml --actuator actuator.yaml -o log.mcap",
    "check": "log.csv -o mapping.yaml",
    "calibrate": "healthy_1.mcap healthy_2.mcap -o calibration.yaml",
    "estimate": "dry.mcap --calibration calibration.yaml",
    "verify": "dry.mcap",
    "baseline": "list",
    "label": 'calibration.yaml dry.mcap --state "dry 1"',
    "moves": "moves.csv --mapping moves.yaml --limit 1.5",
    "new-actuator": "--kv 28 --resistance 1.6 --gear 800 -o spoiler.yaml",
    "certify": "--command swing",
    "design": "--travel 0.01 --sigma friction=0.01 -o test.yaml",
    "compare": "dry.mcap",
    "predict": "unit --hours-per-cycle 10",
    "learn-fleet": "unit_1 unit_2 -o fleet.npz",
    "thesis": "--quick -o study",
    "report": "unit --hours-per-cycle 10 -o unit.html",
    "archive": "run fleet",
    "attach": "--joint 'left/*'",
    "plot": "dry.mcap --window 0 -o dry.png",
    "info": "dry.mcap",
    "record": "-o night.mcap",
    "play": "night.mcap --rate 2",
    "recover": "broken.mcap -o whole.mcap",
    "completion": "bash",
}

ARGUMENTS: Final = "ema.arguments"
"""Context key for the list of command-line arguments."""


class _CommandsOnDemand(click.Group):
    """Command group that imports a command only when it is called."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        ctx.meta[ARGUMENTS] = [ctx.info_name or "ema", *args]
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command:
        if cmd_name not in _COMMANDS:
            from ema_core.wording import unknown_name

            ctx.fail(unknown_name("command", cmd_name, self.list_commands(ctx)))
        name = f"{cmd_name}_" if iskeyword(cmd_name) else cmd_name.replace("-", "_")
        with quiet_imports():
            command = getattr(import_module(f"ema_cli.commands.{name}"), name)
        command.epilog = f"Example: ema {cmd_name} {_EXAMPLES.get(cmd_name, '')}"
        return command

    def invoke(self, ctx: click.Context) -> object:
        from ema_cli.options import errors_as_one_line

        try:
            with errors_as_one_line():
                return super().invoke(ctx)
        except click.NoSuchOption as error:
            from ema_cli.parameters import instead_of

            instead = error.ctx and instead_of(error.option_name, error.ctx.command)
            if not instead:
                raise
            words = f"{error.message.rstrip('.')}{instead}"
            raise click.NoSuchOption(error.option_name, words, ctx=error.ctx) from error

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        width = max(map(len, _COMMANDS))
        for group, commands in _GROUPS.items():
            with formatter.section(group):
                formatter.write_dl([(name.ljust(width), text) for name, text in commands.items()])


@click.group(
    cls=_CommandsOnDemand,
    context_settings={
        "help_option_names": ["-h", "--help"],
        "max_content_width": 100,
        "show_default": True,
    },
)
@click.version_option(__version__, prog_name="ema")
def main() -> None:
    """Detect faults in actuators and robot joints, and predict their remaining life.

    Commands also simulate actuators, robot arms and whole lives.

    Exit codes: 0 success; 1 unusable input, or a node failed; 2 wrong usage or invalid value; 3 the
    data can be read, but the result is refused, incomplete or not OK (the help of each command
    states when). If a signal ends `ema demo`, its exit code is 128 plus the number of the signal.
    """
