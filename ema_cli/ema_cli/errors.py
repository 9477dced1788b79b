"""Exit codes, and errors as one clear line."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Final

import click

from ema_core.wording import as_identifier, unknown_name

UNUSABLE: Final = 1
"""Nothing could be done with the input."""

REFUSED: Final = 3
"""Some windows have no valid estimate. (2 is click's own, for wrong usage.)"""


@contextmanager
def one_clear_line() -> Iterator[None]:
    """Turn what is wrong with the input into an error of one line and exit code ``UNUSABLE``."""
    try:
        yield
    except BrokenPipeError:  # nobody reads on: click ends quietly
        raise
    except (ValueError, OSError) as error:
        words = str(error)
        if isinstance(error, OSError) and error.filename is not None:
            words = f"{error.filename}: {error.strerror}"
        raise click.ClickException(" ".join(words.split())) from error


class NameChoice(click.Choice[str]):
    """One of several names, also written as a label; of a slip it says what was probably meant."""

    def __init__(self, kind: str, names: Iterable[str]) -> None:
        super().__init__(names)
        self._kind = kind

    def normalize_choice(self, choice: object, ctx: click.Context | None) -> str:
        """Return a choice as an identifier."""
        return as_identifier(str(choice))

    def get_invalid_choice_message(self, value: Any, ctx: click.Context | None) -> str:
        """Return what is wrong with a value."""
        return unknown_name(self._kind, str(value), self.choices)


class Assignments(click.ParamType):
    """``name=value`` or ``name=value,name=value``, as pairs of name and number."""

    name = "name=value"

    def __init__(self, as_name: Callable[[str], str] = str.strip) -> None:
        self._as_name = as_name

    def convert(self, value: Any, param: Any, ctx: Any) -> list[tuple[str, float]]:
        """Return the pairs in the order given."""
        if not isinstance(value, str):
            return value
        pairs = []
        for item in value.split(","):
            name, equals, figure = item.partition("=")
            try:
                pairs.append((self._as_name(name), float(figure)))
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
