# SPDX-License-Identifier: Apache-2.0
"""The first line of each source file names the licence; ruff (CPY001) checks Python files."""

import subprocess
from pathlib import Path

from ..packages import ROOT

LICENCE = "SPDX-License-Identifier: Apache-2.0"
MARKS = {
    **{pattern: "#" for pattern in ("*.sh", "*.cmake", "*CMakeLists.txt", "*.yaml", "*.yml")},
    **{pattern: "//" for pattern in ("*.cpp", "*.mjs", "*.ts", "*.tsx")},
}


# Data, and a file that `make calibration` writes.
WITHOUT = ("bags", "ema_monitor/ema_monitor/calibration/builtin_calibration.yaml")


def names_licence(path: Path, mark: str) -> bool:
    lines = path.read_text(encoding="utf-8").splitlines()
    return f"{mark} {LICENCE}" == lines[lines[0].startswith("#!")]


def test_each_source_file_names_its_licence():
    for pattern, mark in MARKS.items():
        command = ["git", "ls-files", pattern, *(f":!{path}" for path in WITHOUT)]
        listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
        files = listed.stdout.splitlines()
        assert files, pattern
        assert [file for file in files if not names_licence(ROOT / file, mark)] == []
    assert (ROOT / "LICENSE").read_text(encoding="utf-8").split()[:4] == [
        *("Apache", "License", "Version", "2.0,")
    ]


def test_definitions_of_messages_begin_with_their_description():
    """Bags contain their text, and `ros2 interface show` prints it from the first line."""
    for kind in ("msg", "srv", "action"):
        paths = [*(ROOT / "ema_interfaces" / kind).glob(f"*.{kind}")]
        assert paths
        assert [path for path in paths if "SPDX" in path.read_text(encoding="utf-8")] == []


def test_a_file_without_the_line_is_named(tmp_path):
    script = tmp_path / "a.sh"
    script.write_text("#!/bin/sh\nset -e\n", encoding="utf-8")
    assert not names_licence(script, "#")
    script.write_text(f"#!/bin/sh\n# {LICENCE}\nset -e\n", encoding="utf-8")
    assert names_licence(script, "#")
