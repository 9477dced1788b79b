# SPDX-License-Identifier: Apache-2.0
"""One version: printed by the command, declared by every package, written into recordings."""

import re
from pathlib import Path

import pytest

from ema_bags.reader import Bag
from ema_core import __version__

from ..packages import FOLDERS

ROOT = Path(__file__).parents[2]
DECLARED = sorted(
    path.relative_to(ROOT)
    for folder in FOLDERS.values()
    for path in (folder / "setup.cfg", folder / "package.xml")
    if path.exists()
)


def test_command_prints_the_version(ema):
    assert ema("--version").output == f"ema, version {__version__}\n"


@pytest.mark.parametrize("path", [*DECLARED, Path("CITATION.cff")], ids=str)
def test_every_package_declares_the_version(path):
    declared = re.findall(
        r"^\s*<?version ?[=>:] ?\"?(\d+\.\d+\.\d+)", (ROOT / path).read_text(), re.MULTILINE
    )
    assert declared == [__version__]


def test_changelog_begins_with_the_version():
    headings = re.findall(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert headings[0] == __version__


def test_recording_names_the_version_that_wrote_it(ema, record, faulty_blocks):
    path = record(faulty_blocks)
    assert Bag(path).writers == [f"ema_bags {__version__}"]
    assert f"written by ema_bags {__version__}" in ema("info", path).output


def test_recording_truncated_in_its_header_names_no_writer(record, faulty_blocks):
    path = record(faulty_blocks)
    path.write_bytes(path.read_bytes()[:20])
    assert Bag(path).writers == []
