"""``ema man``: the help of all commands as a manual page."""

from collections.abc import Iterator

import click


@click.command()
@click.pass_context
def man(ctx: click.Context) -> None:
    """Print the manual page of all commands, made from their help.

    `ema man > ~/.local/share/man/man1/ema.1`, then `man ema`.
    """
    root = ctx.find_root()
    click.echo('.TH EMA 1 "" "ema"\n.SH NAME\nema \\- health of electromechanical actuators')
    for path, text in _helps(root.command, click.Context(root.command, info_name="ema")):
        click.echo(f".SH {path.upper()}\n.nf\n{_escaped(text)}\n.fi")


def _helps(command: click.Command, context: click.Context) -> Iterator[tuple[str, str]]:
    """Return the names and the help of a command and of those below it."""
    yield context.command_path, command.get_help(context)
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            below = command.get_command(context, name)
            if below is not None:
                yield from _helps(below, click.Context(below, context, name))


def _escaped(text: str) -> str:
    lines = text.replace("\\", "\\e").replace("-", "\\-").splitlines()
    return "\n".join(f"\\&{line}" for line in lines)
