# SPDX-License-Identifier: Apache-2.0
"""The tests that `make quick` runs do not import ROS."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
IMPORT_ALL = """
import sys
from importlib import import_module

sys.modules["rclpy"] = None
for name in sys.stdin.read().split():
    try:
        import_module(name)
    except ModuleNotFoundError as error:
        if "rclpy" in str(error):
            print(name)
"""


def folders() -> list[str]:
    """Return the folders of tests that `make quick` runs."""
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    [line] = re.findall(r"^numerics = (.*)$", text, re.MULTILINE)
    return line.split()


def imported(file: Path) -> Iterator[str]:
    """Yield the project's modules that a file imports, and imported names that may be modules."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("ema_"):
            yield node.module or ""
        elif isinstance(node, ast.Import):
            yield from (item.name for item in node.names if item.name.startswith("ema_"))


def test_no_quick_test_imports_ros():
    modules: dict[str, list[str]] = {}
    for file in (file for folder in folders() for file in (ROOT / folder).rglob("*.py")):
        for name in imported(file):
            modules.setdefault(name, []).append(str(file.relative_to(ROOT)))
    assert len(modules) > 100
    done = subprocess.run(
        [sys.executable, "-c", IMPORT_ALL],
        input=" ".join(modules),
        capture_output=True,
        check=True,
        encoding="utf-8",
    )
    assert {name: modules[name] for name in done.stdout.split()} == {}
