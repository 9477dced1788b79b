"""Exit codes, and errors as one clear line."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import click

UNUSABLE: Final = 1
"""Nothing could be done with the input."""

REFUSED: Final = 3
"""Some windows have no valid estimate. (2 is click's own, for wrong usage.)"""


@contextmanager
def one_clear_line() -> Iterator[None]:
    """Turn what is wrong with the input into an error of one line and exit code ``UNUSABLE``."""
    try:
        yield
    except (ValueError, OSError) as error:
        raise click.ClickException(" ".join(str(error).split())) from error


class Assignments(click.ParamType):
    """``name=value`` or ``name=value,name=value``, as pairs of name and number."""

    name = "name=value"

    def convert(self, value: Any, param: Any, ctx: Any) -> list[tuple[str, float]]:
        """Return the pairs in the order given."""
        if not isinstance(value, str):
            return value
        pairs = []
        for item in value.split(","):
            name, equals, figure = item.partition("=")
            try:
                pairs.append((name.strip(), float(figure)))
            except ValueError:
                equals = ""
            if not equals or not name.strip():
                self.fail(f"{item!r} is not name=value with a number as value", param, ctx)
        return pairs


def merged(groups: tuple[list[tuple[str, float]], ...], option: str) -> dict[str, float]:
    """Return the pairs of a repeated option as one mapping; a name may stand only once."""
    pairs = [pair for group in groups for pair in group]
    values = dict(pairs)
    if len(values) != len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise click.UsageError(f"{option}: {twice} is given more than once")
    return values
