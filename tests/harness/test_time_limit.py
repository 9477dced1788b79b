"""The suite always ends: a test beyond its time limit is killed, named, and the others go on."""

import re
import subprocess
import sys
from pathlib import Path

from ..waiting import wait_for

ROOT = Path(__file__).parents[2]
# It holds the interpreter's lock and never gives it back: no thread of Python runs any more.
HANG = "import ctypes; ctypes.PyDLL(None).pause()"
CONFTEST = f"""
import sys
sys.path.insert(0, {str(ROOT)!r})
from tests.orphans import pytest_testnodedown
from tests.scheduling import pytest_xdist_make_scheduler
"""
TESTS = f"""
import subprocess
from pathlib import Path

CHILDREN = []

def test_before():
    CHILDREN.append(subprocess.Popen(["sleep", "1000"]))
    Path(__file__).with_name("child").write_text(str(CHILDREN[0].pid))

def test_that_hangs():
    {HANG}

def test_after():
    pass
"""


def test_test_that_holds_the_interpreter_is_killed_and_named(tmp_path: Path):
    (tmp_path / "conftest.py").write_text(CONFTEST)
    (tmp_path / "test_hanging.py").write_text(TESTS)
    (tmp_path / "test_other.py").write_text("def test_of_another_file():\n    pass\n")
    killed = "import os\n\ndef test_that_dies():\n    os.kill(os.getpid(), 9)\n"
    (tmp_path / "test_killed.py").write_text(killed + "\ndef test_after_it():\n    pass\n")
    command = [sys.executable, "-m", "pytest", "-c", ROOT / "pyproject.toml", "--rootdir", tmp_path]
    command += ["-p", "no:cacheprovider", "-o", "faulthandler_timeout=2"]
    command += ["-n", "1", "--dist", "loadfile", tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 1, done.stdout + done.stderr
    assert re.search(r"worker 'gw\d+' crashed while running '[^']*::test_that_hangs'", done.stdout)
    # The stacks of all threads are there, down to the line that hangs.
    assert "Timeout (0:00:02)!" in done.stderr
    assert "line 12 in test_that_hangs" in done.stderr
    assert "2 failed, 4 passed" in done.stdout
    # What its process had started is gone as well.
    child = Path("/proc", (tmp_path / "child").read_text(), "cmdline")
    wait_for(lambda: not child.exists() or not child.read_bytes(), "the end of its child")
