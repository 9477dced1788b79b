# SPDX-License-Identifier: Apache-2.0
"""Form of docstrings that ruff does not check."""

import ast
import subprocess
from pathlib import Path

from ..packages import ROOT


def classes_with_attributes(path: Path) -> list[str]:
    """Return the dataclasses and named tuples whose docstring has a section of attributes."""
    return [
        f"{path.name}:{node.lineno} {node.name}"
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
        and any(
            "dataclass" in ast.unparse(item) or "NamedTuple" in ast.unparse(item)
            for item in (*node.decorator_list, *node.bases)
        )
        and "\nAttributes\n---" in (ast.get_docstring(node) or "")
    ]


def test_fields_of_a_dataclass_are_documented_beside_the_field():
    command = ["git", "ls-files", "ema_*/*.py", "ros2_ws/src/*.py"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    paths = [ROOT / line for line in listed.stdout.splitlines()]
    assert len(paths) > 400
    assert [line for path in paths for line in classes_with_attributes(path)] == []


def test_section_of_attributes_in_a_dataclass_is_found(tmp_path: Path):
    path = tmp_path / "planted.py"
    docstring = '"""Planted.\n\n    Attributes\n    ----------\n    """'
    path.write_text(f"@dataclass\nclass Planted:\n    {docstring}\n", encoding="utf-8")
    assert classes_with_attributes(path) == ["planted.py:2 Planted"]
