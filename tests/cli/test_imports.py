"""Commands import what they need and no more: they start quickly."""

import subprocess
import sys
from pathlib import Path

from ..commands import SAMPLE

LIST_IMPORTS = """
import sys
from ema_cli.main import main
for options in [], ["--json"][: sys.argv[1] == "estimate"]:
    main([*sys.argv[1:], *options], standalone_mode=False)
print(*sys.modules)
"""
# numba imports scipy itself, to check its version.
PICTURES_TABLES_ROS = {"matplotlib", "pandas", "jinja2", "scipy.special", "rclpy", "sqlite3"}


def imported(*arguments: str | Path) -> set[str]:
    """Names of the modules that a command has imported when it is done."""
    done = subprocess.run(
        [sys.executable, "-c", LIST_IMPORTS, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=True,
    )
    return set(done.stdout.splitlines()[-1].split())


def test_help_imports_no_command():
    modules = imported("--help")
    ours = {name for name in modules if name.startswith("ema_")}
    core = {"ema_core", "ema_core.linear_algebra", "ema_core.start"}
    assert ours == {"ema_cli", "ema_cli.main"} | core
    assert not modules & {"numpy", "rich", "yaml"}


def test_info_imports_neither_compiler_nor_what_draws_tables_and_bars():
    modules = imported("info", SAMPLE)
    assert not modules & (PICTURES_TABLES_ROS | {"numba", "rich", "yaml", "numpy.random"})
    assert not any(name.startswith("ema_monitor.identification") for name in modules)


def test_estimate_imports_no_pictures_no_node_and_no_prognosis():
    # numba brings sqlite3 where coverage is installed.
    modules = imported("estimate", SAMPLE)
    assert not modules & (PICTURES_TABLES_ROS - {"sqlite3"})
    assert not any(name.startswith(("ema_monitor.prognosis", "ema_sim")) for name in modules)
