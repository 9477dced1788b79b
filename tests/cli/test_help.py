"""The list of commands: what each says of itself, without importing any."""

import subprocess
import sys

from click.testing import CliRunner

from ema_cli.main import _COMMANDS, main


def test_list_says_of_each_command_what_its_own_help_begins_with():
    runner = CliRunner()
    for name, first in _COMMANDS.items():
        said = " ".join(runner.invoke(main, [name, "--help"]).stdout.split())
        assert f" {first}" in said


def test_help_imports_no_command():
    listed = subprocess.run(
        [
            sys.executable,
            "-c",
            "import sys\nfrom ema_cli.main import main\n"
            "main(['--help'], standalone_mode=False)\n"
            "print([m for m in sys.modules if m in ('numpy', 'rclpy') or m.startswith('ema_')])",
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    assert listed.stdout.splitlines()[-1] == "['ema_cli', 'ema_core', 'ema_cli.main']"
