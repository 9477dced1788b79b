"""Every package has a quality declaration, and the documents that it rests on are there."""

import re
from pathlib import Path

import pytest

from ..packages import FOLDERS

ROOT = Path(__file__).parents[2]
QUALITY = ROOT / "docs" / "quality.md"
PACKAGES = sorted(FOLDERS.values())
LINK = re.compile(r"\]\(([^)#]+)(?:#([^)]*))?\)")


def anchors(text: str) -> set[str]:
    """Return the anchors of the headings of a document."""
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
def test_package_declares_its_quality(package):
    declaration = package.resolve() / "QUALITY_DECLARATION.md"
    text = declaration.read_text(encoding="utf-8")
    assert text.startswith(f"# Quality declaration of {package.name}\n")
    assert "**Level 4**" in text
    check_links(declaration)
    linked = [QUALITY.parent / target for target, _ in LINK.findall(QUALITY.read_text())]
    assert declaration in [path.resolve() for path in linked]


@pytest.mark.parametrize("place", ["*.md", "docs/*.md"])
def test_links_of_the_documents_lead_somewhere(place):
    for document in ROOT.glob(place):
        check_links(document)
