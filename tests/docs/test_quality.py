# SPDX-License-Identifier: Apache-2.0
"""The quality of each package is declared, and links between documents are valid."""

import re
from pathlib import Path

import pytest

from ..packages import FOLDERS

ROOT = Path(__file__).parents[2]
QUALITY = ROOT / "docs" / "quality.md"
PACKAGES = sorted(FOLDERS.values())
LINK = re.compile(r"\]\(([^)#]+)(?:#([^)]*))?\)")


def anchors(text: str) -> set[str]:
    """Return the anchors of the headings in a document."""
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}


def check_links(document: Path) -> None:
    for target, anchor in LINK.findall(document.read_text(encoding="utf-8")):
        if target.startswith("http"):
            continue
        path = document.parent / target
        assert path.exists(), f"{document}: {target} is not there"
        if anchor:
            assert anchor in anchors(path.read_text(encoding="utf-8")), f"{document}: #{anchor}"


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_package_declares_its_interface_and_tests(package):
    text = QUALITY.read_text(encoding="utf-8")
    rows = re.findall(rf"^\| \[{package.name}\].*$", text, re.MULTILINE)
    assert len(rows) == 1
    _, interface, tests, _ = (cell.strip() for cell in rows[0].strip("|").split(" | ", 3))
    assert interface
    folders = re.findall(r"`(tests/[\w/.]+)`", tests)
    assert folders
    assert all((ROOT / folder).exists() for folder in folders), folders


@pytest.mark.parametrize("place", ["*.md", "docs/*.md"])
def test_links_of_the_documents_are_valid(place):
    for document in ROOT.glob(place):
        check_links(document)
