"""The files of the page, read once and served from memory."""

import gzip
import hashlib
from dataclasses import dataclass
from importlib.resources import files
from pathlib import PurePath
from typing import Final

_INDEX: Final = "index.html"
# Not those of the machine: a browser runs no script of another type.
_CONTENT_TYPES: Final = {
    ".css": "text/css",
    ".html": "text/html",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
    ".txt": "text/plain",
}
_NOT_BUILT: Final = b"""<!doctype html>
<html lang="en"><meta charset="utf-8"><title>EMA dashboard</title>
<h1>The page is not built</h1>
<p>Run <code>make page</code>. Foxglove can connect to this address meanwhile.</p>
</html>
"""


@dataclass(frozen=True)
class PageFile:
    """One file: its content, the same compressed, its type and a tag that changes with it."""

    content: bytes
    compressed: bytes
    content_type: str
    tag: str


def read_page() -> dict[str, PageFile]:
    """Return the files of the page by the path at which they are served, the page itself at ``/``.

    Raises
    ------
    OSError
        When a file cannot be read.
    """
    folder = files("ema_dashboard").joinpath("page")
    found = {}
    if folder.is_dir():
        for item in folder.iterdir():
            if item.is_file() and not item.name.startswith("."):
                found[f"/{item.name}"] = _page_file(item.name, item.read_bytes())
    found["/"] = found.pop(f"/{_INDEX}", None) or _page_file(_INDEX, _NOT_BUILT)
    return found


def _page_file(name: str, content: bytes) -> PageFile:
    content_type = _CONTENT_TYPES.get(PurePath(name).suffix, "application/octet-stream")
    tag = hashlib.sha256(content).hexdigest()[:32]
    return PageFile(content, gzip.compress(content, mtime=0), content_type, tag)
