# SPDX-License-Identifier: Apache-2.0
"""Web server of the dashboard: the page over HTTP, and Foxglove's protocol over WebSocket."""

import asyncio
import json
import logging
import socket
import ssl
import time
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Final

from aiohttp import web

from ema_core.steady_thread import SteadyThread
from ema_dashboard.access import Access
from ema_dashboard.client import MOST_REQUEST_BYTES, SUBPROTOCOL, Client
from ema_dashboard.contents import Document, Documents, Made, read_page
from ema_dashboard.hub import Hub
from ema_ros.throttle import Throttle

_COOKIE: Final = "ema_dashboard"
_FIRST_S: Final = 2.0
_PATIENCE_S: Final = 10.0
_ANSWER_S: Final = 30.0
_SHUTDOWN_S: Final = 1.0
_LOG_PERIOD_S: Final = 30.0
_MOST_LOGGED: Final = 300
_MOST_BODY_BYTES: Final = 4096
_SPARE_CONNECTIONS: Final = 32  # for the page's files, in addition to the clients
_SEND_BUFFER_BYTES: Final = 256 * 1024
_HEADERS: Final = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class WebServer:
    """Serves page, documents and WebSocket in a thread that runs the hub's event loop.

    Parameters
    ----------
    listener
        Bound socket, closed with the server.
    tls
        TLS context; None for HTTP.
    access
        Access control.
    hub
        Source of the messages.
    control
        Called with a request for a playback; raises ValueError for an invalid request.
    posts
        Functions called with the JSON of a POST request, by path; they raise ValueError if the
        request is refused.
    most_clients
        Largest number of clients.
    most_bytes
        Largest size of the queue of a client [B].
    documents
        Functions that compute documents, by path.
    on_failure
        Called if the thread ends unexpectedly.
    """

    def __init__(
        self,
        listener: socket.socket,
        tls: ssl.SSLContext | None,
        access: Access,
        hub: Hub,
        control: Callable[[bytes], None],
        posts: Mapping[str, Callable[[Any], Awaitable[None]]],
        most_clients: int,
        most_bytes: int,
        documents: Mapping[str, Document],
        on_failure: Callable[[str, str], object],
    ) -> None:
        self._listener = listener
        self._tls = tls
        self._access = access
        self._hub = hub
        self._control = control
        self._posts = dict(posts)
        self._most_clients = most_clients
        self._most_bytes = most_bytes
        self._scheme = "https" if tls else "http"
        self._page = read_page()
        self._documents = Documents(documents)
        self._loop = hub.loop
        self._log = logging.Logger("ema_dashboard.http")
        self._log.addHandler(_Failures(hub))
        self.thread = SteadyThread("dashboard", self._run, on_failure)

    def start(self) -> None:
        """Start serving.

        Raises
        ------
        OSError
            If the server cannot listen.
        """
        self.thread.start()
        asyncio.run_coroutine_threadsafe(self._open(), self._loop).result()

    def stop(self) -> None:
        """Disconnect all clients and stop serving."""
        self.thread.ending.set()
        # This stops the loop even if it is about to start or restart.
        self._loop.call_soon_threadsafe(self._loop.stop)
        self.thread.end()
        # If the thread had ended unexpectedly, the call above is still queued in the loop.
        self._loop.call_soon(self._loop.stop)
        self._loop.run_forever()
        # Close in this thread, because the thread of the server may have ended.
        self._loop.run_until_complete(self._close())
        self._loop.close()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_forever()

    async def _open(self) -> None:
        application = web.Application(client_max_size=_MOST_BODY_BYTES, middlewares=[self._guard])
        application.router.add_get("/{path:.*}", self._serve)
        for path in self._posts:
            application.router.add_post(path, self._post)
        self._runner = web.AppRunner(
            application,
            access_log=None,
            logger=self._log,
            keepalive_timeout=_PATIENCE_S,
            shutdown_timeout=_SHUTDOWN_S,
        )
        await self._runner.setup()
        assert self._runner.server is not None
        self._http = self._runner.server
        self._waiting: dict[Any, asyncio.TimerHandle] = {}
        # Connections without a request so far, the oldest first.
        self._mute: dict[Any, None] = {}
        self._site = await self._loop.create_server(
            self._protocol,
            sock=self._listener,
            ssl=self._tls,
            ssl_handshake_timeout=_PATIENCE_S if self._tls else None,
        )

    async def _close(self) -> None:
        self._site.close()
        self._hub.end_all(1001, b"the dashboard ends")
        connections = [protocol.transport for protocol in self._http.connections]
        await self._runner.cleanup()
        for transport in filter(None, connections):
            transport.abort()  # unsent data would keep the connection open
        for waiting in self._waiting.values():
            waiting.cancel()
        await asyncio.sleep(0)  # lets the connections end
        await self._loop.shutdown_default_executor()

    def _protocol(self) -> asyncio.Protocol:
        """Return the protocol for a new connection, which must send a request in time.

        At the limit of connections, the oldest connection without a request is closed. If there is
        none, the new connection is refused.
        """
        protocol = self._http()
        if len(self._http.connections) >= self._most_clients + _SPARE_CONNECTIONS:
            self._hub.totals.refused += 1
            # Connections with requests have priority over connections without.
            mute = next((item for item in self._mute if item.transport is not None), None)
            if mute is None:
                return _Refusal()
            self._limit(mute, None)
            mute.transport.abort()
        self._limit(protocol, _FIRST_S)
        self._mute[protocol] = None
        return protocol

    def _limit(self, protocol: Any, seconds: float | None) -> None:
        """Set a time limit for a connection's next step [s]; None for no limit."""
        self._mute.pop(protocol, None)
        waiting = self._waiting.pop(protocol, None)
        if waiting is not None:
            waiting.cancel()
        if seconds is not None:
            self._waiting[protocol] = self._loop.call_later(seconds, self._give_up, protocol)

    def _give_up(self, protocol: Any) -> None:
        del self._waiting[protocol]
        if protocol in self._mute:
            del self._mute[protocol]
            self._hub.totals.refused += 1
        if protocol.transport is not None:
            protocol.transport.abort()  # without the unsent data

    @web.middleware
    async def _guard(self, request: web.Request, handler: Callable[..., Any]) -> web.StreamResponse:
        """Refuse unauthorised requests before any further processing."""
        # Time to receive the answer, and to send a further request.
        self._limit(request.protocol, _ANSWER_S)
        reason = self._access.refuses(
            request.headers.get("Host", ""),
            _reached(request),
            self._scheme,
            request.headers.get("Origin"),
        )
        if reason:
            return self._refuse(403, reason)
        shown = request.query.get("token")
        kind, _, bearer = request.headers.get("Authorization", "").partition(" ")
        if kind.lower() == "bearer":
            shown = bearer.strip()
        cookie = request.cookies.get(_COOKIE)
        if not self._access.permits(token=shown, cookie=cookie):
            fault = (
                "a token is required" if shown is None and cookie is None else "the token is wrong"
            )
            return self._refuse(401, f"{fault}: Authorization: Bearer, or /?token=")
        return await handler(request)

    async def _serve(self, request: web.Request) -> web.StreamResponse:
        if request.headers.get("Upgrade", "").lower() == "websocket":
            return await self._connect(request)
        if "token" in request.query and self._access.needs_token:
            # Keeps the token out of address line, history and screenshots. The path is relative,
            # because a proxy may serve the page below another path.
            location = f"./{request.rel_url.raw_path.rpartition('/')[2]}"
            answer = web.Response(status=303, headers={**_HEADERS, "Location": location})
            answer.set_cookie(
                _COOKIE,
                self._access.cookie,
                httponly=True,
                samesite="Strict",
                secure=self._tls is not None,
            )
            return answer
        if request.path in self._documents:
            return await self._documents.answer(request, _HEADERS)
        file = self._page.get(request.path)
        if file is None:
            return self._refuse(404, f"{request.path[:100]} not found")
        return self._file(request, file)

    async def _post(self, request: web.Request) -> web.StreamResponse:
        # Pages of other origins may send this type only after a preflight, which is not answered.
        if request.content_type != "application/json":
            return self._refuse(415, "expected application/json")
        try:
            await self._posts[request.path](json.loads(await request.read()))
        except (ValueError, RecursionError) as error:
            return self._refuse(400, str(error))
        return web.Response(status=204, headers=_HEADERS)

    def _file(self, request: web.Request, file: Made) -> web.Response:
        # WebSockets are listed, because not all browsers include them in 'self'.
        sockets = " ".join(self._access.sockets(request.headers["Host"], self._scheme))
        headers = {
            **_HEADERS,
            "Content-Security-Policy": (
                "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
                f"font-src 'self'; connect-src 'self' {sockets}; base-uri 'none'; "
                "form-action 'none'; frame-ancestors 'none'"
            ),
            "Content-Type": file.content_type,
            "Vary": "Accept-Encoding",
        }
        answer = web.Response(body=file.content, headers=headers)
        answer.enable_compression()
        return answer

    async def _connect(self, request: web.Request) -> web.StreamResponse:
        if self._hub.totals.clients >= self._most_clients:
            return self._refuse(503, f"{self._most_clients} clients are already connected")
        offered = request.headers.get("Sec-WebSocket-Protocol", "")
        if SUBPROTOCOL not in [item.strip() for item in offered.split(",")]:
            return self._refuse(400, f"expected the subprotocol {SUBPROTOCOL}, not {offered!r}")
        self._hub.totals.clients += 1
        try:
            connection = web.WebSocketResponse(
                protocols=(SUBPROTOCOL,),
                max_msg_size=MOST_REQUEST_BYTES,
                compress=False,
                autoping=False,
                timeout=1.0,
            )
            self._limit(request.protocol, None)
            _limit_buffer(request)
            await connection.prepare(request)
            await Client(self._hub, connection, self._control, self._most_bytes).run()
            return connection
        finally:
            self._hub.totals.clients -= 1

    def _refuse(self, status: int, reason: str) -> web.Response:
        self._hub.totals.refused += 1
        return web.Response(status=status, text=f"{reason}\n", headers=_HEADERS)


class _Failures(logging.Handler):
    """Counts malformed requests, and logs them at a limited rate."""

    def __init__(self, hub: Hub) -> None:
        super().__init__()
        self._hub = hub
        self._throttle = Throttle(_LOG_PERIOD_S)

    def emit(self, record: logging.LogRecord) -> None:
        self._hub.totals.refused += 1
        error = record.exc_info[1] if record.exc_info else None
        summary = f"{record.getMessage()}: {' '.join(str(error).split())}"[:_MOST_LOGGED]
        line = self._throttle.passed(summary, time.monotonic())
        if line is not None:
            logging.getLogger("ema_dashboard").warning(line)


class _Refusal(asyncio.Protocol):
    """Protocol that immediately closes connections above the limit."""

    def connection_made(self, transport: Any) -> None:
        transport.abort()


def _reached(request: web.Request) -> str:
    """Return the local address at which a request arrived."""
    transport = request.transport
    name = transport.get_extra_info("sockname") if transport else None
    return str(name[0]) if name else ""


def _limit_buffer(request: web.Request) -> None:
    """Limit a client's kernel send buffer, in which messages cannot be dropped."""
    connection = request.transport and request.transport.get_extra_info("socket")
    if connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
