# SPDX-License-Identifier: Apache-2.0
"""The web server stops at any time, also while its thread restarts."""

import asyncio
import socket
import threading

import pytest

from ema_dashboard import web_server
from ema_dashboard.access import Access
from ema_dashboard.hub import Hub
from ema_dashboard.settings import bound_socket
from ema_dashboard.web_server import WebServer

from ...waiting import DEADLINE_S, wait_for


@pytest.fixture
def server():
    listener = bound_socket("127.0.0.1", 0, 1)
    made = WebServer(
        listener, None, Access([], [], ""), Hub(), lambda _: None, {}, 4, 1000, {}, print
    )
    made.start()
    return made


def has_stopped(server: WebServer, port: int) -> bool:
    with socket.socket() as client:
        return not server.thread.is_alive and client.connect_ex(("127.0.0.1", port)) != 0


@pytest.mark.parametrize("moment", ["running", "ended", "about to run again"])
def test_server_stops(server: WebServer, monkeypatch: pytest.MonkeyPatch, moment: str):
    port = server._listener.getsockname()[1]
    begun, may_run = threading.Event(), threading.Event()

    def set_loop(loop: asyncio.AbstractEventLoop) -> None:
        begun.set()
        may_run.wait(DEADLINE_S)
        as_before(loop)

    as_before = asyncio.set_event_loop
    if moment != "running":
        monkeypatch.setattr(web_server.asyncio, "set_event_loop", set_loop)
        server._loop.call_soon_threadsafe(server._loop.stop)
        wait_for(lambda: server.thread.ends == 1, "the end of the work")
    if moment == "about to run again":
        assert begun.wait(DEADLINE_S)
    stopping = threading.Thread(target=server.stop)
    stopping.start()
    wait_for(lambda: server.thread.ending.is_set(), "the request to stop")
    may_run.set()
    stopping.join(DEADLINE_S)
    assert not stopping.is_alive()
    assert has_stopped(server, port)
