"""What the port serves beside the page: texts that are made when they are asked for."""

import asyncio
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from aiohttp import web

_MOST_WAITING: Final = 16


class Made(NamedTuple):
    """A text with the type that its header gives, and the status of the answer."""

    content: bytes
    content_type: str
    status: int = 200


Document = Callable[[Mapping[str, str], str], Made]
"""Makes a text in any thread, of the query of an address and the header ``Accept``."""


class Documents:
    """Texts by their paths, each made in a thread beside the server, for one client after another.

    Parameters
    ----------
    documents
        What makes them, by path.
    """

    def __init__(self, documents: Mapping[str, Document]) -> None:
        self._documents = dict(documents)
        self._turns = {path: asyncio.Lock() for path in documents}
        self._waiting = 0

    def __contains__(self, path: str) -> bool:
        return path in self._documents

    async def answer(self, request: web.Request, headers: Mapping[str, str]) -> web.Response:
        """Return the text at the path of a request; status 503 where too many wait for theirs."""
        if self._waiting >= _MOST_WAITING:
            words = f"{self._waiting} requests are waiting for an answer already\n"
            return web.Response(status=503, text=words, headers=headers)
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
