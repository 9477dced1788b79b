# SPDX-License-Identifier: Apache-2.0
"""Contents of the web server by path: files of the page, and documents computed on request."""

import asyncio
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path, PurePath
from typing import Final, NamedTuple

from aiohttp import web

_MOST_WAITING: Final = 16
# Fixed, because the machine's types may be wrong, and browsers refuse scripts of a wrong type.
_CONTENT_TYPES: Final = {
    ".css": "text/css",
    ".html": "text/html",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
    ".txt": "text/plain",
}
_LIMIT_S: Final = 5.0
_MOST_WORST: Final = 100
_NUMBERS: Final = frozenset(map(str, range(1, _MOST_WORST + 1)))


class Made(NamedTuple):
    """Response body with its content type and status."""

    content: bytes
    content_type: str
    status: int = 200


def read_page() -> dict[str, Made]:
    """Return the files of the page by path, with the page itself at ``/``.

    Raises
    ------
    OSError
        If a file cannot be read.
    """
    folder = files("ema_dashboard").joinpath("page")
    contents = {
        f"/{item.name}": Made(item.read_bytes(), _CONTENT_TYPES[PurePath(item.name).suffix])
        for item in folder.iterdir()
        if item.is_file() and not item.name.startswith(".")
    }
    contents["/"] = contents.pop("/index.html")
    return contents


Document = Callable[[Mapping[str, str], str], Made]
"""Function that computes a document from the query and the header ``Accept``, in any thread."""


class Documents:
    """Documents by path, computed in separate threads, each for one client at a time.

    Parameters
    ----------
    documents
        Functions that compute the documents, by path.
    """

    def __init__(self, documents: Mapping[str, Document]) -> None:
        self._documents = dict(documents)
        self._turns = {path: asyncio.Lock() for path in documents}
        self._waiting = 0

    def __contains__(self, path: str) -> bool:
        return path in self._documents

    async def answer(self, request: web.Request, headers: Mapping[str, str]) -> web.Response:
        """Return the document of a request; status 503 if too many requests are waiting."""
        if self._waiting >= _MOST_WAITING:
            text = f"{self._waiting} requests are already waiting for a response\n"
            return web.Response(status=503, text=text, headers=headers)
        make, accept = self._documents[request.path], request.headers.get("Accept", "")
        query = {name: value for name, value in request.query.items() if name != "token"}
        self._waiting += 1
        try:
            async with self._turns[request.path]:
                made = await asyncio.to_thread(make, query, accept)
        finally:
            self._waiting -= 1
        answer = web.Response(
            body=made.content,
            status=made.status,
            headers={**headers, "Content-Type": made.content_type, "Vary": "Accept"},
        )
        answer.enable_compression()
        return answer


class FleetDocument:
    """Summary of the fleet of an archive; the latest summary is cached.

    ``archive`` is the folder of the archive, empty without one.
    """

    def __init__(self, archive: str) -> None:
        self._archive = Path(archive).expanduser() if archive else None
        self._made: tuple[object, bytes] = None, b""

    def __call__(self, query: Mapping[str, str], _: str) -> Made:
        """Return the summary as JSON, or with status 503 the reason why there is none.

        ``most`` in the query is the number of units and of models to list.
        """
        try:
            return Made(self._content(query.get("most", str(_MOST_WORST))), "application/json")
        except (OSError, ValueError) as error:
            return Made(json.dumps({"reason": str(error)}).encode(), "application/json", 503)

    def _content(self, most: str) -> bytes:
        if self._archive is None:
            return json.dumps({"archive": None}).encode()
        if most not in _NUMBERS:
            raise ValueError(f"most = {most[:20]!r}: expected 1 to {_MOST_WORST}")
        # Imported here, because the import takes a second.
        from ema_archive.fleet import fleet_summary, state_of_archive

        key = state_of_archive(self._archive), int(most)
        if self._made[0] != key:
            summary = asdict(fleet_summary(self._archive, int(most), _LIMIT_S))
            content = {"archive": self._archive.name, **summary}
            self._made = key, json.dumps(content, allow_nan=False).encode()
        return self._made[1]
