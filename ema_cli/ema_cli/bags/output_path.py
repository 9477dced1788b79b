"""Where a command may write: never onto what it reads, and onto nothing else unless forced."""

from collections.abc import Iterable, Iterator
from pathlib import Path


def require_apart(output: Path, inputs: Iterable[Path]) -> None:
    """Refuse an output that is an input, or a file of one that is a folder, by whatever name."""
    if not output.exists():
        return
    for path in inputs:
        if any(output.samefile(item) for item in _with_members(path)):
            raise ValueError(f"{output} is the input {path} itself: give another name")


def require_free(output: Path, inputs: Iterable[Path], *, overwrite: bool) -> None:
    """Refuse an output that is an input, or any other file unless it is to be replaced."""
    require_apart(output, inputs)
    if not overwrite and (output.exists() or output.is_symlink()):
        raise ValueError(f"{output} is there already: --replace replaces it")


def _with_members(path: Path) -> Iterator[Path]:
    if path.exists():
        yield path
    if path.is_dir():
        yield from path.iterdir()
