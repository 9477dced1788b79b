"""Bags that a command writes."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import click

from ema_bags.writer import BagWriter


def _as_stamp(_: click.Context, __: click.Parameter, moment: datetime) -> int:
    """Return a date and time in UTC as nanoseconds; messages have no stamps after January 2038."""
    if not 1970 <= moment.year < 2038:
        raise click.BadParameter(f"{moment:%Y-%m-%d}: expected a date from 1970 to 2037")
    return int(moment.replace(tzinfo=UTC).timestamp()) * 1_000_000_000


START_OPTION: Final = click.option(
    "--start",
    "start_ns",
    type=click.DateTime(),
    metavar="DATE",
    default="1970-01-01",
    callback=_as_stamp,
    help="When the first cycle begins (UTC), as 2026-03-01 or 2026-03-01T08:30:00: bags of one "
    "unit need times of their own.",
)


@contextmanager
def new_bag(path: Path, *, overwrite: bool = False) -> Iterator[BagWriter]:
    """Give a bag to write to; nothing is left of one that could not be written."""
    try:
        with BagWriter(path, overwrite=overwrite) as bag:
            yield bag
    except FileExistsError as error:
        hint = "" if overwrite else ": --replace replaces a recording"
        raise ValueError(f"{error}{hint}") from error
    except OSError as error:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
