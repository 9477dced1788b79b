# SPDX-License-Identifier: Apache-2.0
"""Strict parser for the HTML pages that the commands write."""

from html.parser import HTMLParser
from pathlib import Path

_EMPTY = {"meta", "img", "br", "path", "use"}
"""Elements without an end tag. Elements of pictures are written as XML."""


class Page(HTMLParser):
    """A parsed page: texts by element, attributes, and tables with exact values.

    Elements that are not closed, or closed in the wrong order, are errors.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.text = path.read_text(encoding="utf-8")
        self.size = path.stat().st_size
        self.tables: dict[str, list[list[str]]] = {}
        self.figures: dict[str, list[list[float]]] = {}
        self.attributes: list[tuple[str, str, str]] = []
        self.printed: dict[str, list[str]] = {}
        self._open: list[str] = []
        self._texts: list[str] = []
        self._caption = ""
        self.feed(self.text)
        self.close()
        assert self._open == []
        self.words = " ".join(" ".join(self._texts).split())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attrs)
        if tag not in _EMPTY:
            self._open.append(tag)
            self.printed.setdefault(tag, []).append("")
        if tag == "table":
            self._caption = ""
        elif tag == "tr":
            self.tables.setdefault(self._caption, []).append([])
            self.figures.setdefault(self._caption, []).append([])
        elif tag in ("td", "th"):
            self.tables[self._caption][-1].append("")
        elif tag == "data":
            self.figures[self._caption][-1].append(float(dict(attrs)["value"] or "nan"))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag, f"</{tag}> at {self.getpos()} closes another element"

    def handle_data(self, data: str) -> None:
        self._texts.append(data)
        for tag in self._open:
            self.printed[tag][-1] += data
        if "caption" in self._open:
            self._caption += data
        elif {"td", "th"} & set(self._open):
            self.tables[self._caption][-1][-1] += data

    def values(self, name: str) -> list[str]:
        """Return the values of an attribute in all elements."""
        return [value for _, attribute, value in self.attributes if attribute == name]

    def table(self, beginning: str) -> list[list[str]]:
        """Return the cells of a table without its head; its caption starts with ``beginning``."""
        return next(rows for name, rows in self.tables.items() if name.startswith(beginning))[1:]

    def exactly(self, beginning: str) -> list[list[float]]:
        """Return the exact values of a table without its head."""
        return next(rows for name, rows in self.figures.items() if name.startswith(beginning))[1:]
