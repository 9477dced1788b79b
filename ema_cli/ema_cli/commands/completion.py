# SPDX-License-Identifier: Apache-2.0
"""``ema completion``: shell completion of commands, options and files."""

from typing import Final

import click
from click.shell_completion import get_completion_class

_SHELLS: Final = ("bash", "zsh", "fish")


@click.command()
@click.argument("shell", type=click.Choice(_SHELLS))
@click.pass_context
def completion(ctx: click.Context, shell: str) -> None:
    """Print the shell completion script for SHELL.

    For bash, run `ema completion bash >> ~/.bashrc` and open a new shell.
    """
    root = ctx.find_root()
    completion_class = get_completion_class(shell)
    assert completion_class is not None, shell
    click.echo(completion_class(root.command, {}, "ema", "_EMA_COMPLETE").source())
