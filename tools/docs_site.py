# SPDX-License-Identifier: Apache-2.0
"""MkDocs hooks of `make docs`.

The hooks insert the help of all commands and all message definitions, replace links to files
outside docs with the paths of the files, and convert formulas to MathML. The build fails if the
site would make a request to another host.
"""

import html
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from latex2mathml.converter import convert  # pyright: ignore[reportMissingImports]
from mkdocs.exceptions import PluginError  # pyright: ignore[reportMissingImports]
from mkdocs.plugins import event_priority, get_plugin_logger  # pyright: ignore[reportMissingImports]

ROOT: Final = Path(__file__).resolve().parents[1]
LOG: Final = get_plugin_logger("docs_site")
OUTSIDE: Final = re.compile(r"\[([^\]]*)\]\(\.\./([^)#\s]+)(?:#[^)]*)?\)")
FORMULA: Final = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
# Elements that a browser would load. For the last two, Material's script loads from unpkg.com and
# github.com.
REQUEST: Final = re.compile(
    r"<(?:script|img|link|iframe|source|video|object|embed)\b[^>]*\b(?:src|href|data)=[\"']?(?:https?:)?//[^>]*"
    r"|(?:url\(|@import )[\"']?(?:https?:)?//[^)\s]*"
    r"|class=\"mermaid\"|data-md-component=\"source\""
)
# A command in the list at the end of the help of a group.
COMMAND: Final = re.compile(r"^  ([a-z][a-z-]*)", re.MULTILINE)
SECTION: Final = re.compile(r"^([A-Z]\w*):\n((?:  .*\n)+)", re.MULTILINE)
HELP, DEFINITIONS = "<!-- help of all commands -->", "<!-- definitions of all messages -->"


def _section(title: str, text: str) -> str:
    return f"## `{title}`\n\n```text\n{text.strip()}\n```\n\n"


def _commands(text: str) -> Iterator[str]:
    """Yield the commands listed below the headings of a help text."""
    for heading, lines in SECTION.findall(text):
        if heading != "Options":
            yield from COMMAND.findall(lines)


def _help(command: str) -> Iterator[str]:
    """Yield the help of a command and of its subcommands."""
    shell = ["bash", "-euc", f". ./activate.sh; {command} --help"]
    text = subprocess.run(
        shell, cwd=ROOT, capture_output=True, text=True, check=True, encoding="utf-8"
    ).stdout
    yield _section(command, text)
    for name in _commands(text):
        yield from _help(f"{command} {name}")


def _definitions() -> Iterator[str]:
    """Yield the definition of each message, service and action."""
    for path in sorted((ROOT / "ema_interfaces").glob("*/*.*")):
        if path.suffix in {".msg", ".srv", ".action"}:
            yield _section(f"{path.parent.name}/{path.stem}", path.read_text(encoding="utf-8"))


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Insert generated sections, and replace links to files outside docs with the file paths."""
    if HELP in markdown:
        markdown = markdown.replace(HELP, "".join(_help("ema")))
    if DEFINITIONS in markdown:
        markdown = markdown.replace(DEFINITIONS, "".join(_definitions()))

    def path_of(link: re.Match[str]) -> str:
        text, path = link.groups()
        if not (ROOT / path).exists():
            LOG.warning(f"{page.file.src_uri}: no file {path}")
        return f"`{path}`" if path.startswith(text.strip("`")) else f"{text} (`{path}`)"

    # In a subfolder of docs, links to other pages also start with "../".
    return markdown if "/" in page.file.src_uri else OUTSIDE.sub(path_of, markdown)


def on_page_content(content: str, page: Any, **_: Any) -> str:
    """Convert formulas to MathML."""

    def drawn(formula: re.Match[str]) -> str:
        block = formula[1] == "div"
        math = convert(html.unescape(formula[2]), display="block" if block else "inline")
        if "\\" in math:
            LOG.warning(f"{page.file.src_uri}: formula with an unknown command: {formula[2]}")
        return f'<div class="formula">{math}</div>' if block else math

    return FORMULA.sub(drawn, content)


@event_priority(-100)
def on_post_build(config: Any) -> None:
    """Fail if the site makes requests to other hosts, or has no search index."""
    site = Path(config.site_dir)
    requests = [
        f"{path.relative_to(site)}: {request[0]}"
        for path in sorted(site.rglob("*"))
        if path.suffix in {".html", ".css"}
        for request in REQUEST.finditer(path.read_text(encoding="utf-8"))
    ]
    if requests:
        raise PluginError("requests to other hosts:\n" + "\n".join(requests))
    if not (site / "search" / "search_index.json").is_file():
        raise PluginError("no search index")
