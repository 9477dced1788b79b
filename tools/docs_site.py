"""What MkDocs does for `make docs` beyond its plugins.

The help of all commands and the definitions of all messages are inserted. Links to files outside
of docs become their paths, formulas become MathML, and the build fails where the site would ask
another host for something.
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
# What a browser would load; of the last two, Material's script loads from unpkg.com and github.com.
REQUEST: Final = re.compile(
    r"<(?:script|img|link|iframe|source|video|object|embed)\b[^>]*\b(?:src|href|data)=[\"']?(?:https?:)?//[^>]*"
    r"|(?:url\(|@import )[\"']?(?:https?:)?//[^)\s]*"
    r"|class=\"mermaid\"|data-md-component=\"source\""
)
# A command in the list that ends the help of a group.
COMMAND: Final = re.compile(r"^  ([a-z][a-z-]*)", re.MULTILINE)
SECTION: Final = re.compile(r"^([A-Z]\w*):\n((?:  .*\n)+)", re.MULTILINE)
HELP, DEFINITIONS = "<!-- help of all commands -->", "<!-- definitions of all messages -->"


def _section(title: str, text: str) -> str:
    return f"## `{title}`\n\n```text\n{text.strip()}\n```\n\n"


def _commands(text: str) -> Iterator[str]:
    """Yield the commands in a help, which lists them below headings."""
    for heading, lines in SECTION.findall(text):
        if heading != "Options":
            yield from COMMAND.findall(lines)


def _help(command: str) -> Iterator[str]:
    """Yield the help of a command and of those within it."""
    shell = ["bash", "-euc", f". ./activate.sh; {command} --help"]
    text = subprocess.run(
        shell, cwd=ROOT, capture_output=True, text=True, check=True, encoding="utf-8"
    ).stdout
    yield _section(command, text)
    for name in _commands(text):
        yield from _help(f"{command} {name}")


def _definitions() -> Iterator[str]:
    """Yield each message, service and action."""
    for path in sorted((ROOT / "ema_interfaces").glob("*/*.*")):
        if path.suffix in {".msg", ".srv", ".action"}:
            yield _section(f"{path.parent.name}/{path.stem}", path.read_text(encoding="utf-8"))


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Insert what is generated; show links to files outside of docs as the paths of the files."""
    if HELP in markdown:
        markdown = markdown.replace(HELP, "".join(_help("ema")))
    if DEFINITIONS in markdown:
        markdown = markdown.replace(DEFINITIONS, "".join(_definitions()))

    def path_of(link: re.Match[str]) -> str:
        text, path = link.groups()
        if not (ROOT / path).exists():
            LOG.warning(f"{page.file.src_uri}: no file {path}")
        return f"`{path}`" if path.startswith(text.strip("`")) else f"{text} (`{path}`)"

    # A page in a folder of docs leads to other pages by the same signs.
    return markdown if "/" in page.file.src_uri else OUTSIDE.sub(path_of, markdown)


def on_page_content(content: str, page: Any, **_: Any) -> str:
    """Turn formulas to MathML."""

    def drawn(formula: re.Match[str]) -> str:
        block = formula[1] == "div"
        math = convert(html.unescape(formula[2]), display="block" if block else "inline")
        if "\\" in math:
            LOG.warning(f"{page.file.src_uri}: formula with an unknown command: {formula[2]}")
        return f'<div class="formula">{math}</div>' if block else math

    return FORMULA.sub(drawn, content)


@event_priority(-100)
def on_post_build(config: Any) -> None:
    """Fail where the site asks another host for something, or has no search index."""
    site = Path(config.site_dir)
    asked = [
        f"{path.relative_to(site)}: {request[0]}"
        for path in sorted(site.rglob("*"))
        if path.suffix in {".html", ".css"}
        for request in REQUEST.finditer(path.read_text(encoding="utf-8"))
    ]
    if asked:
        raise PluginError("requests to other hosts:\n" + "\n".join(asked))
    if not (site / "search" / "search_index.json").is_file():
        raise PluginError("no search index")
