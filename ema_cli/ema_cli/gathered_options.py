"""Options that several commands share, given to each of them as one argument."""

from collections.abc import Callable, Collection, Sequence
from functools import wraps
from typing import Any

from ema_cli.errors import one_clear_line

Command = Callable[..., None]


def gathered(
    name: str,
    build: Callable[..., Any],
    names: Collection[str],
    options: Sequence[Callable[[Command], Command]],
) -> Callable[[Command], Command]:
    """Return a decorator that gives a command options.

    Parameters
    ----------
    name
        Argument of the command.
    build
        Makes it of the options, by keyword.
    names
        Names of the options, and perhaps others.
    """

    def add_options(command: Command) -> Command:
        @wraps(command)
        def with_options(**given: Any) -> None:
            own = {key: given.pop(key) for key in names if key in given}
            with one_clear_line():
                built = build(**own)
            command(**{name: built}, **given)

        decorated: Command = with_options
        for option in reversed(options):
            decorated = option(decorated)
        return decorated

    return add_options
