# SPDX-License-Identifier: Apache-2.0
"""Commands run in the test process, and the sample bag that they read."""

import re
from pathlib import Path

from click.testing import CliRunner, Result

from ema_cli import progress
from ema_cli.main import main

# Commands print no progress, even on a busy machine.
progress.FIRST_LINE_S = 3600.0  # pyright: ignore[reportConstantRedefinition, reportAttributeAccessIssue]

SAMPLE = Path(__file__).parents[1] / "bags" / "faulty_flap.mcap"
"""Bag of one window, with friction of 0.25 and eccentricity of 0.1."""


_PROGRESS = re.compile(r"^.*: .*\b(so far|about \d+ \w+ left)\n", re.MULTILINE)


def without_progress(error: str) -> str:
    """Return the standard error of a process without the progress that busy machines print."""
    return _PROGRESS.sub("", error)


def ema(*arguments: str | Path, typed: str = "") -> Result:
    """Run a command of ``ema``; ``typed`` is its standard input. Exceptions fail the test."""
    result = CliRunner().invoke(main, [str(argument) for argument in arguments], input=typed)
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result
