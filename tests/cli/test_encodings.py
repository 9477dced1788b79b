# SPDX-License-Identifier: Apache-2.0
"""Commands work in any locale, and with any file name."""

import os
import subprocess
from pathlib import Path

import pytest
import yaml

from ..commands import SAMPLE

NAME = os.fsdecode(b"a\xff.mcap")
NO_UTF_8 = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
TABLE = "t;pos;Öl;command\n" + "".join(f"{i / 1000};0.{i:04d};1;0.{i:04d}\n" for i in range(400))


def run(folder: Path, *words: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    """Run a command in a folder; check that its output is UTF-8."""
    done = subprocess.run(
        ["ema", *words], cwd=folder, capture_output=True, env=os.environ | environment
    )
    done.stdout.decode("utf-8")
    assert "codec" not in done.stderr.decode("utf-8")
    return done


@pytest.mark.parametrize("environment", [{}, NO_UTF_8], ids=["utf-8", "C"])
def test_file_whose_name_is_not_utf_8_is_read_and_written(tmp_path, environment):
    (tmp_path / NAME).write_bytes(SAMPLE.read_bytes())
    assert run(tmp_path, "info", NAME, **environment).returncode == 0
    done = run(tmp_path, "estimate", NAME, **environment)
    assert (done.returncode, b"valid, goodness of fit" in done.stdout) == (0, True)
    page = os.fsdecode(b"p\xff.html")
    run(tmp_path, "report", NAME, "-o", page, **environment)
    assert "a\\udcff.mcap" in (tmp_path / page).read_text(encoding="utf-8")


@pytest.mark.parametrize("environment", [{}, NO_UTF_8], ids=["utf-8", "C"])
def test_mapping_of_a_table_is_in_utf_8(tmp_path, environment):
    table = os.fsdecode(b"t\xff.csv")
    (tmp_path / table).write_text(TABLE, encoding="utf-8")
    done = run(tmp_path, "check", table, "-o", "m.yaml", **environment)
    assert done.returncode == 3
    assert "'Öl'" in done.stdout.decode("utf-8")
    text = (tmp_path / "m.yaml").read_text(encoding="utf-8")
    assert yaml.safe_load(text)["position"]["source"] == "pos"


def test_name_that_an_archive_cannot_store_is_refused(tmp_path):
    (tmp_path / "fleet").mkdir()
    (tmp_path / "fleet" / NAME).write_bytes(SAMPLE.read_bytes())
    done = run(tmp_path, "archive", "scan", "archive", "fleet")
    assert done.returncode == 1
    assert b"is not UTF-8: rename the file" in done.stderr
