"""Files that are written completely or not at all."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def complete_file(path: Path) -> Iterator[Path]:
    """Yield a temporary name to write to; the file is renamed when the block ends.

    Parameters
    ----------
    path
        File to write; an existing one is replaced once the new one is complete.

    Raises
    ------
    OSError
        When it cannot be written; the error names the file, and no part of it is left.
    """
    partial = path.with_name(f"{path.name}.partial")
    try:
        yield partial
        partial.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
    finally:
        partial.unlink(missing_ok=True)
