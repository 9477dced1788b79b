"""The list of commands: what each says of itself, without importing any."""

from click.testing import CliRunner

from ema_cli.main import _COMMANDS, main


def test_list_says_of_each_command_what_its_own_help_begins_with():
    runner = CliRunner()
    for name, first in _COMMANDS.items():
        said = " ".join(runner.invoke(main, [name, "--help"]).stdout.split())
        assert f" {first}" in said
