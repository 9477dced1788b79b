# SPDX-License-Identifier: Apache-2.0
"""Commands, run in the process of the test, and the sample that they read."""

import re
from pathlib import Path

from click.testing import CliRunner, Result

from ema_cli import progress
from ema_cli.main import main

# No command prints its progress, however busy the machine is.
progress.FIRST_LINE_S = 3600.0  # pyright: ignore[reportConstantRedefinition, reportAttributeAccessIssue]

SAMPLE = Path(__file__).parents[1] / "bags" / "faulty_flap.mcap"
"""Bag of one window, with friction of 0.25 and eccentricity of 0.1."""


_PROGRESS = re.compile(r"^.*: .*\b(so far|about \d+ \w+ left)\n", re.MULTILINE)


def without_progress(error: str) -> str:
    """Return what a process printed on standard error, without the progress of a busy machine."""
    return _PROGRESS.sub("", error)


def ema(*arguments: str | Path, typed: str = "") -> Result:
    """Run a command with what is typed; what is not an exit code is an error of the test."""
    result = CliRunner().invoke(main, [str(argument) for argument in arguments], input=typed)
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result
