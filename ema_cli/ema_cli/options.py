# SPDX-License-Identifier: Apache-2.0
"""Exit codes, one-line errors, and options shared by commands."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Final

import click

from ema_core.wording import as_identifier, unknown_name

UNUSABLE: Final = 1
"""Exit code: the input cannot be used, or a node has failed."""

REFUSED: Final = 3
"""Exit code: a result is refused, incomplete or not OK. (click uses 2 for wrong usage.)"""


@contextmanager
def errors_as_one_line() -> Iterator[None]:
    """Convert ValueError and OSError to a one-line error with exit code ``UNUSABLE``."""
    try:
        yield
    except BrokenPipeError:  # the reader has closed the pipe: click ends quietly
        raise
    except (ValueError, OSError) as error:
        words = str(error)
        if isinstance(error, UnicodeEncodeError):
            words = f"the file name {error.object!r} is not UTF-8: rename the file"
        if isinstance(error, OSError) and error.filename is not None:
            words = f"{error.filename}: {error.strerror}"
        raise click.ClickException(" ".join(words.split())) from error


@contextmanager
def values_of_options() -> Iterator[None]:
    """Convert ValueError, raised for an invalid option value, to a usage error (exit code 2)."""
    try:
        yield
    except ValueError as error:
        raise click.UsageError(str(error)) from error


class NameChoice(click.Choice[str]):
    """Option type: one of several names or labels; errors for typos suggest a name."""

    def __init__(self, kind: str, names: Iterable[str]) -> None:
        super().__init__(names)
        self._kind = kind

    def normalize_choice(self, choice: object, ctx: click.Context | None) -> str:
        """Convert a choice to an identifier."""
        return as_identifier(str(choice))

    def get_invalid_choice_message(self, value: Any, ctx: click.Context | None) -> str:
        """Return the error text for an invalid value."""
        return unknown_name(self._kind, str(value), self.choices)


class Assignments(click.ParamType):
    """Option type: ``name=value`` or ``name=value,name=value``, with numeric values."""

    name = "name=value"

    def convert(self, value: Any, param: Any, ctx: Any) -> list[tuple[str, float]]:
        """Return the pairs of name and value, in order."""
        if not isinstance(value, str):
            return value
        pairs = []
        for item in value.split(","):
            name, equals, figure = item.partition("=")
            try:
                pairs.append((as_identifier(name), float(figure)))
            except ValueError:
                equals = ""
            if not equals or not name.strip():
                self.fail(f"{item!r}: expected name=value with a number as value", param, ctx)
        return pairs


def assignments_option(
    option: str, name: str, meaning: str, kind: click.ParamType | None = None
) -> Callable[..., Any]:
    """Return a repeatable option of ``name=value`` pairs; the command receives a dict.

    A repeated name is a usage error. ``name`` is the argument of the command, ``meaning`` the help.
    """

    def merged(
        _: click.Context, __: click.Parameter, groups: tuple[list[tuple[str, float]], ...]
    ) -> dict[str, float]:
        values: dict[str, float] = {}
        for key, value in (pair for group in groups for pair in group):
            if key in values:
                raise click.UsageError(f"{option}: {key} is specified more than once")
            values[key] = value
        return values

    return click.option(
        option, name, type=kind or Assignments(), multiple=True, callback=merged, help=meaning
    )


def network_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the option ``--network`` to a command, which receives it as the argument ``network``."""
    return click.option(
        "--network",
        is_flag=True,
        help=(
            "Allow communication with nodes on other machines, subject to ROS's own variables; "
            "by default nodes only communicate on this machine."
        ),
    )(command)
