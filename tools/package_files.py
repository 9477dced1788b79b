# SPDX-License-Identifier: Apache-2.0
"""Write the files and lines that all packages share.

``make package-files`` runs this tool: maintainer, author, address and licence of every package
from ``CITATION.cff``, ``CHANGELOG.rst`` from ``CHANGELOG.md``, ``LICENSE``, and the requirements
of a ROS workspace from the ``setup.cfg`` of all packages. tests/library checks that all are up to
date.
"""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.sax.saxutils import escape

import yaml
from packaging.requirements import Requirement
from setuptools.config.setupcfg import read_configuration

ROOT: Final = Path(__file__).parents[1]
FOLDERS: Final = {
    path.parent.name: path.parent
    for place in ("ema_*", "ros2_ws/src/ema_*")
    for path in sorted(ROOT.glob(f"{place}/package.xml"))
}
"""Folder of each package, keyed by the name of the package."""

WORKSPACE: Final = ROOT / "requirements" / "workspace.txt"

REPOSITORY: Final = "repository"
"""Owner of entries in ``CHANGELOG.md`` that concern no package."""

SECTIONS: Final = {
    "Unknown drives and robot joints": "ema_monitor",
    "Diagnosis of modelled drives": "ema_monitor",
    "Never a wrong OK": "ema_monitor",
    "Life and removal": "ema_monitor",
    "Import and tables": "ema_bags",
    "Recording, replay, archive": "ema_bags",
    "Page, metrics and access": "ema_dashboard",
    "Commands": "ema_cli",
    "Python API": "ema_monitor",
}
"""Package of the entries of a section that end without a comment such as ``<!-- ema_sim -->``."""

BOUNDS: Final = {"numpy": ">=1.26,<2", "pyarrow": ">=21,<26"}
"""Bounds in a ROS workspace.

Jazzy's messages for Ubuntu 24.04 are compiled for numpy 1, which pyarrow 26 refuses when it is
imported.
"""


class Release(NamedTuple):
    """A version in the changelog."""

    label: str
    """Version and date, or "Forthcoming"."""

    entries: list[tuple[set[str], str]]
    """Owners and Markdown text of each entry."""


def files() -> dict[Path, str]:
    """Return the content of the files to write, keyed by path."""
    owner = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    licence = (ROOT / "LICENSE").read_text(encoding="utf-8")
    releases = list(_releases((ROOT / "CHANGELOG.md").read_text(encoding="utf-8")))
    contents = {WORKSPACE: workspace(FOLDERS.values())}
    for name, folder in FOLDERS.items():
        contents[folder / "LICENSE"] = licence
        contents[folder / "CHANGELOG.rst"] = changelog(name, releases)
        manifest = folder / "package.xml"
        contents[manifest] = package_xml(manifest.read_text(encoding="utf-8"), owner)
        setup = folder / "setup.cfg"
        if setup.exists():
            contents[setup] = setup_cfg(setup.read_text(encoding="utf-8"), owner)
    return contents


def package_xml(text: str, owner: dict[str, Any]) -> str:
    """Return a ``package.xml`` with the maintainer, licence, URL and author of ``owner``."""
    [contact], [author] = owner["contact"], owner["authors"]
    lines = (
        f'<maintainer email="{contact["email"]}">{escape(contact["name"])}</maintainer>',
        f'<license file="LICENSE">{owner["license"]}</license>',
        f'<url type="website">{escape(owner["url"])}</url>',
        f"<author>{escape(author['name'])}</author>",
    )
    return _replaced(r"(?<=</description>\n).*?(?=\n\n)", [f"  {line}" for line in lines], text)


def setup_cfg(text: str, owner: dict[str, Any]) -> str:
    """Return a ``setup.cfg`` with the licence, maintainer, author and URL of ``owner``."""
    [contact], [author] = owner["contact"], owner["authors"]
    fields = {
        "license": owner["license"],
        "maintainer": contact["name"],
        "maintainer_email": contact["email"],
        "author": author["name"],
        "url": owner["url"],
    }
    lines = [f"{name} = {value}" for name, value in fields.items()]
    return _replaced(r"(?<=\n)license = .*?(?=\n\n)", lines, text)


def changelog(name: str, releases: Iterable[Release]) -> str:
    """Return the ``CHANGELOG.rst`` of a package, as described by REP 132."""
    title = f"Changelog for package {name}"
    lines = ["^" * len(title), title, "^" * len(title)]
    for release in releases:
        entries = [text for owners, text in release.entries if name in owners]
        if entries:
            lines += ["", release.label, "-" * len(release.label)]
            lines += [f"* {_restructured(text)}" for text in entries]
    return "\n".join(lines) + "\n"


def workspace(folders: Iterable[Path]) -> str:
    """Return the requirements of packages from other projects, with their bounds."""
    required: dict[str, str] = {}
    for folder in folders:
        if not (folder / "setup.cfg").exists():
            continue
        options = read_configuration(folder / "setup.cfg")["options"]
        extras = options.get("extras_require", {}).values()
        for lines in (options["install_requires"], *extras):
            for item in map(Requirement, lines):
                if item.name not in FOLDERS:
                    bounds = ",".join(sorted(map(str, item.specifier), reverse=True))
                    required[item.name] = BOUNDS.get(item.name, bounds)
    source = "setup.cfg of each package, with what `colcon test` needs"
    head = f"# Written by `make package-files` from {source}.\n"
    return head + "".join(f"{name}{bounds}\n" for name, bounds in sorted(required.items()))


def _replaced(pattern: str, lines: Iterable[str], text: str) -> str:
    """Return a text with lines in place of the first match of a pattern."""
    return re.sub(pattern, lambda _: "\n".join(lines), text, count=1, flags=re.DOTALL)


def _releases(text: str) -> Iterator[Release]:
    """Yield the versions of ``CHANGELOG.md``. A version without a date is not released."""
    for part in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        version, _, body = part.partition("\n")
        section, entries = "", []
        for block in re.split(r"\n(?=\S)", body):
            text = " ".join(block.split())
            if block.startswith("### "):
                section = text.removeprefix("### ")
            elif block.startswith("- "):
                entries.append(_owned(section, text.removeprefix("- ")))
        yield Release(version if "(" in version else "Forthcoming", entries)


def _owned(section: str, text: str) -> tuple[set[str], str]:
    """Return the owners of an entry, and its text without the comment that names them.

    Raises ValueError if an entry has no owner, or an owner that is not a package.
    """
    entry, _, comment = text.partition(" <!-- ")
    owners = set((comment.removesuffix("-->") or SECTIONS.get(section, "")).split())
    if not owners or owners - {REPOSITORY, *FOLDERS}:
        raise ValueError(
            f"CHANGELOG.md: {entry[:60]!r} has the owners {sorted(owners)}: end the entry with "
            f"<!-- PACKAGE ... -->, packages of this repository, or with <!-- {REPOSITORY} -->"
        )
    return owners, entry


def _restructured(text: str) -> str:
    """Convert a text from Markdown to reStructuredText."""
    text = re.sub(r"\[([^]]+)\]\([^)]+\)", r"\1", text)
    code = re.split(r"`([^`]*)`", text)
    plain = (re.sub(r"([*|_\\])", r"\\\1", part) for part in code[::2])
    literal = (f"``{part}``" for part in code[1::2])
    pieces = [next(plain)]
    for code_part, after in zip(literal, plain, strict=True):
        # Inline literals end at a space or a punctuation mark.
        pieces += [code_part, "\\ " if after[:1].isalnum() else "", after]
    return "".join(pieces)


if __name__ == "__main__":
    for path, content in files().items():
        path.write_text(content, encoding="utf-8")
