# SPDX-License-Identifier: Apache-2.0
"""Output options and checks: no input is overwritten, other files only with ``--replace``."""

import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

if TYPE_CHECKING:
    from ema_bags.writer import BagWriter

BAG_TO_WRITE: Final = "Bag to write: a single file if the name ends in .mcap, else a folder"
"""Help text of the option ``--output`` of commands that write a bag."""


def output_option(
    meaning: str, *, required: bool = True, dir_okay: bool = True, **more: Any
) -> Callable[..., Any]:
    """Return a decorator that adds ``--output`` and ``--replace`` to a command.

    The command receives the arguments ``output`` and ``overwrite``. ``meaning`` is the help text.
    """
    more |= {"required": required, "type": click.Path(path_type=Path, dir_okay=dir_okay)}
    output = click.option("-o", "--output", help=f"{meaning}.", **more)
    replace = click.option("--replace", "overwrite", is_flag=True, help="Overwrite OUTPUT.")
    return lambda command: output(replace(command))


def require_apart(output: Path, inputs: Iterable[Path]) -> None:
    """Raise ValueError if an output is an input or in an input folder, under any path."""
    if not output.exists():
        return
    for path in filter(Path.exists, inputs):
        members = path.iterdir() if path.is_dir() else ()
        if any(output.samefile(item) for item in (path, *members)):
            raise ValueError(f"{output} is the same as the input {path}: choose another name")


def require_free(
    output: Path, inputs: Iterable[Path], *, overwrite: bool, endings: Sequence[str] = ()
) -> None:
    """Check that an output can be written, before any work is done.

    Parameters
    ----------
    output
        Path to write.
    inputs
        Paths of the inputs.
    overwrite
        Whether an existing file is replaced.
    endings
        Permitted suffixes; empty for any.

    Raises
    ------
    ValueError
        If the output is an input, exists without ``overwrite``, or its folder is missing.
    click.BadParameter
        If its suffix is not permitted.
    """
    if endings and output.suffix.lower() not in endings:
        raise click.BadParameter(f"{output}: expected a name that ends in {' or '.join(endings)}")
    if endings and not output.parent.is_dir():
        raise ValueError(f"{output}: folder {output.parent} does not exist: create it first")
    require_apart(output, inputs)
    if not overwrite and (output.exists() or output.is_symlink()):
        raise ValueError(f"{output} already exists: use --replace to overwrite it")


def _as_stamp(_: click.Context, __: click.Parameter, moment: datetime) -> int:
    """Convert a UTC date to a timestamp [ns]; ROS timestamps end in January 2038."""
    if not 1970 <= moment.year < 2038:
        raise click.BadParameter(f"{moment:%Y-%m-%d}: expected a date from 1970 to 2037")
    return int(moment.replace(tzinfo=UTC).timestamp()) * 1_000_000_000


def start_option(meaning: str) -> Callable[..., Any]:
    """Return the option ``--start``; the command receives ``start_ns`` [ns].

    ``meaning`` is the help text.
    """
    return click.option(
        "--start",
        "start_ns",
        type=click.DateTime(),
        metavar="DATE",
        default="1970-01-01",
        callback=_as_stamp,
        help=f"{meaning}.",
    )


@contextmanager
def new_bag(path: Path, *, overwrite: bool = False) -> Iterator["BagWriter"]:
    """Yield a new bag to write to; remove it if writing fails.

    Raises
    ------
    ValueError
        If ``path`` exists and is not overwritten.
    OSError
        If the bag cannot be written.
    """
    from ema_bags.writer import BagWriter  # imports ROS only if a bag is written

    try:
        with BagWriter(path, overwrite=overwrite) as bag:
            yield bag
    except FileExistsError as error:
        hint = "" if overwrite else ": use --replace to overwrite a recording"
        raise ValueError(f"{error}{hint}") from error
    except OSError as error:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
