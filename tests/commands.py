"""Commands, run in the process of the test, and the sample that they read."""

from pathlib import Path

from click.testing import CliRunner, Result

from ema_cli.main import main

SAMPLE = Path(__file__).parents[1] / "bags" / "faulty_flap.mcap"
"""Bag of one window, with friction of 0.25 and eccentricity of 0.1."""


def ema(*arguments: str | Path, typed: str = "") -> Result:
    """Run a command with what is typed; what is not an exit code is an error of the test."""
    result = CliRunner().invoke(main, [str(argument) for argument in arguments], input=typed)
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result
