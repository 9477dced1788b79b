# SPDX-License-Identifier: Apache-2.0
"""The help of commands: the list, which imports no command, and its length."""

import shlex

import click
import pytest
from click.testing import CliRunner

from ema_cli.main import _COMMANDS, _GROUPS, main


def test_list_shows_the_first_line_of_each_help():
    runner = CliRunner()
    for name, first in _COMMANDS.items():
        printed = " ".join(runner.invoke(main, [name, "--help"]).stdout.split())
        assert f" {first}" in printed


@pytest.mark.parametrize("name", _COMMANDS)
def test_help_fits_a_screen_of_40_lines(name):
    """The limit includes the help of subcommands, on a terminal of 80 columns."""
    context = click.Context(main)
    command = main.get_command(context, name)
    below = command.list_commands(context) if isinstance(command, click.Group) else []
    for path in [[name], *([name, subcommand] for subcommand in below)]:
        printed = CliRunner().invoke(main, [*path, "--help"], terminal_width=78).stdout
        assert len(printed.splitlines()) <= 40, printed


@pytest.mark.parametrize("name", _COMMANDS)
def test_examples_in_the_help_are_valid_commands(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for path in ("moves.csv", "unit_1", "unit_2"):
        (tmp_path / path).touch()
    printed = CliRunner().invoke(main, [name, "--help"]).stdout
    words = shlex.split(printed.rpartition("Example: ema ")[2])
    assert words[0] == name
    main.get_command(click.Context(main), name).make_context(name, words[1:])


def test_help_lists_each_command_in_one_group():
    assert sum(map(len, _GROUPS.values())) == len(_COMMANDS)
    text = CliRunner().invoke(main, ["--help"], terminal_width=100).stdout
    places = [text.index(f"\n{group}:\n") for group in _GROUPS]
    assert places == sorted(places)
    for name in _COMMANDS:
        assert f"\n  {name} " in text


@pytest.mark.parametrize("name", ["prognose", "learn"])
def test_command_has_one_name(name):
    result = CliRunner().invoke(main, [name, "--help"])
    assert result.exit_code == 2
    assert f"command {name!r}" in result.output
