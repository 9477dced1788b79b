# SPDX-License-Identifier: Apache-2.0
"""`make test-pythons` names the Pythons that are missing, and fails if it tests none."""

import os
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "tools" / "test_pythons.sh"


@pytest.mark.parametrize("is_on_the_path", [False, True])
def test_python_that_is_missing_or_cannot_be_set_up_is_named(tmp_path: Path, is_on_the_path: bool):
    if is_on_the_path:
        program = tmp_path / "python3.99"
        program.write_text(
            "#!/bin/sh\nexit 1\n"
        )  # This is how a Python without venv or headers ends.
        program.chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    done = subprocess.run(
        [SCRIPT, "3.99"], capture_output=True, text=True, check=False, env=environment
    )
    summary = "test-pythons: passed: none; failed: none; not found: 3.99\n"
    assert (done.returncode, done.stdout) == (1, summary), done.stderr
