"""Commands, run in the process of the test."""

from pathlib import Path

from click.testing import CliRunner, Result

from ema_cli.main import main


def ema(*arguments: str | Path) -> Result:
    """Run a command; what is not an exit code is an error of the test."""
    result = CliRunner().invoke(main, [str(argument) for argument in arguments])
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result
