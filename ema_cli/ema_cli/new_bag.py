"""Bags that a command writes."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ema_bags.writer import BagWriter


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
