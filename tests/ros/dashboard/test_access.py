# SPDX-License-Identifier: Apache-2.0
"""The dashboard serves permitted clients only, and hostile clients do not disturb them."""

import asyncio
import json
import os
import socket
import ssl
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from aiohttp import ClientError, WSServerHandshakeError
from rclpy.serialization import serialize_message

from ema_dashboard import web_server
from ema_dashboard.client import Client
from ema_dashboard.dashboard_node import DashboardNode
from ema_interfaces.msg import Health, UnitHistory
from ema_ros import topics
from ema_ros.status import ERROR

from ...waiting import wait_for
from ..spinning import ros_context
from .client import SUBPROTOCOL, Web
from .session import DashboardSession, values, wait_for_value

TOKEN = "0123456789abcdef-token"


@pytest.fixture
def token_file(tmp_path: Path) -> Path:
    path = tmp_path / "token"
    path.write_text(f"{TOKEN}\n")
    return path


@pytest.fixture(scope="module")
def _shared(web: Web) -> Iterator[tuple[DashboardSession, DashboardNode]]:
    with ros_context() as context:
        session = DashboardSession(context, web)
        yield session, session.dashboard()
        session.close()


@pytest.fixture
def served(_shared) -> Iterator[tuple[DashboardSession, DashboardNode]]:
    """A shared dashboard with default parameters, which tests must not change."""
    yield _shared
    _shared[0].leave()


def port_of(node: DashboardNode) -> int:
    return int(node.address.rstrip("/").rpartition(":")[2])


def refused_handshake(web: Web, url: str, protocol: str = SUBPROTOCOL, **headers: str) -> int:
    """Return the HTTP status with which a WebSocket is refused; 101 if it is accepted."""

    async def connect() -> int:
        try:
            async with web.session.ws_connect(url, protocols=(protocol,), headers=headers):
                return 101
        except WSServerHandshakeError as error:
            return error.status

    return web.run(connect())


def refusal(session: DashboardSession, **parameters: Any) -> str:
    """Return the reason why a dashboard with these parameters does not start."""
    node = session.unconfigured(**parameters)
    assert not node.bring_up()
    task = node._lifecycle_task()  # published on /diagnostics
    assert task.level == ERROR
    return task.message


def test_page_is_served_with_a_policy_that_permits_only_its_origin(served, web):
    _, node = served
    status, headers, content = web.get(node.address)
    assert (status, headers["Content-Type"]) == (200, "text/html")
    assert b"<!doctype html>" in content.lower()
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "script-src 'self';" in policy
    assert f"connect-src 'self' ws://{node.address.split('/')[2]};" in policy
    assert headers["Cache-Control"] == "no-store"
    assert headers["X-Content-Type-Options"] == "nosniff"
    for path in ("nothing", "../setup.py", "%2e%2e/settings.py", "page_files.py"):
        assert web.get(f"{node.address}{path}")[0] == 404


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 101),
        ({"Origin": "https://app.foxglove.dev"}, 101),
        ({"Origin": "https://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": "http://localhost.evil.example"}, 403),
        ({"Host": "evil.example"}, 403),
        ({"Host": "localhost.evil.example:80", "Origin": "http://localhost.evil.example:80"}, 403),
    ],
)
def test_foreign_pages_and_names_are_refused(served, web, headers, status):
    _, node = served
    before = values(node)["refused requests"]
    assert refused_handshake(web, node.address, **headers) == status
    assert values(node)["refused requests"] - before == (status != 101)


def test_own_origin_and_configured_origins_may_connect(session, web):
    node = session.dashboard(allowed_origins=["https://mine.example"], host_names=["box.example"])
    port = port_of(node)
    assert refused_handshake(web, node.address, Origin=node.address.rstrip("/")) == 101
    assert refused_handshake(web, node.address, Origin="https://mine.example") == 101
    assert refused_handshake(web, node.address, Origin="https://app.foxglove.dev") == 403
    named = {"Host": f"box.example:{port}", "Origin": f"http://box.example:{port}"}
    assert refused_handshake(web, node.address, **named) == 101


def test_token_is_required_if_configured(session, web, token_file):
    node = session.dashboard(token_file=str(token_file))
    assert web.get(node.address)[0] == 401
    assert refused_handshake(web, node.address) == 401
    assert refused_handshake(web, node.address, Authorization="Bearer wrong") == 401
    assert refused_handshake(web, node.address, Authorization=f"Bearer {TOKEN}") == 101
    assert refused_handshake(web, f"{node.address}?token={TOKEN}") == 101
    status, headers, _ = web.get(f"{node.address}?token={TOKEN}")
    assert (status, headers["Location"]) == (303, "./")
    cookie = headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert TOKEN not in cookie
    shown = cookie.partition(";")[0]
    assert web.get(node.address, headers={"Cookie": shown})[0] == 200
    assert refused_handshake(web, node.address, Cookie=shown) == 101


def test_refusal_states_the_check_that_failed(session, web, token_file):
    node = session.dashboard(token_file=str(token_file))

    def reported(**headers: str) -> tuple[int, str]:
        # The page sends this request after its WebSocket is refused, to learn the reason.
        async def ask() -> tuple[int, str]:
            async with web.session.post(node.address, headers=headers) as answer:
                return answer.status, await answer.text()

        return web.run(ask())

    shown = {"Authorization": f"Bearer {TOKEN}"}
    assert reported() == (401, "a token is required: Authorization: Bearer, or /?token=\n")
    assert reported(Authorization="Bearer x") == (
        401,
        "the token is wrong: Authorization: Bearer, or /?token=\n",
    )
    status, words = reported(**shown, Host="evil.example")
    assert (status, words[:30]) == (403, "host 'evil.example' is not per")
    status, words = reported(**shown, Origin="https://evil.example")
    assert (status, words[:36]) == (403, "origin 'https://evil.example' is not")
    assert reported(**shown)[0] == 405


def test_token_and_tls_are_required_beyond_loopback(session, token_file, certificate):
    pem, key = map(str, certificate)
    assert "token_file and tls_certificate as well" in refusal(session, host="0.0.0.0")
    assert "or tls_certificate as well" in refusal(
        session, host="0.0.0.0", token_file=str(token_file)
    )
    assert "without tls_key" in refusal(session, tls_certificate=pem)
    assert "are not usable" in refusal(session, tls_certificate=key, tls_key=pem)
    short = token_file.with_name("short")
    short.write_text("secret")
    assert "has 6 characters" in refusal(session, token_file=str(short))
    assert "cannot be read" in refusal(session, token_file=str(token_file / "none"))


def test_dashboard_with_tls_and_token_serves_all_addresses(session, web, token_file, certificate):
    pem, key = map(str, certificate)
    session.source.create_publisher(Health, "health", topics.ALIVE).publish(
        Health(actuator_id="flap")
    )
    node = session.dashboard(
        host="0.0.0.0", token_file=str(token_file), tls_certificate=pem, tls_key=key
    )
    trust = ssl.create_default_context(cafile=pem)
    url = f"https://127.0.0.1:{port_of(node)}/"
    _, headers, _ = web.get(f"{url}?token={TOKEN}", ssl=trust)
    assert "Secure" in headers["Set-Cookie"]
    viewer = web.view(url, ssl=trust, headers={"Authorization": f"Bearer {TOKEN}"})
    session.viewers.append(viewer)
    viewer.subscribe_to("/ema/health")
    viewer.wait_for("/ema/health")


def test_occupied_port_is_skipped_or_refused(session):
    first = session.dashboard()
    port = port_of(first)
    assert f"cannot listen on port {port} of 127.0.0.1" in refusal(session, port=port, ports=1)
    second = session.dashboard(port=port, ports=100)
    assert port_of(second) > port


def test_clients_beyond_the_limit_are_refused_until_one_leaves(session, web):
    node = session.dashboard(most_clients=2)
    viewers = [session.view(node) for _ in range(2)]
    assert refused_handshake(web, node.address) == 503
    assert web.get(node.address)[0] == 200  # the limit does not apply to the page itself
    viewers[0].close()
    wait_for_value(node, "clients", 1)
    assert refused_handshake(web, node.address) == 101


async def hostile(web: Web, url: str, frames: list[str | bytes]) -> int | None:
    """Send frames to a dashboard, then read until it closes. Return the close code."""
    with suppress(ConnectionError, ClientError):
        async with web.session.ws_connect(url, protocols=(SUBPROTOCOL,)) as connection:
            with suppress(ConnectionError, ClientError):
                for frame in frames:
                    if isinstance(frame, str):
                        await connection.send_str(frame)
                    else:
                        await connection.send_bytes(frame)
            while not connection.closed:
                await asyncio.wait_for(connection.receive(), 10.0)
            return connection.close_code
    return None


SUBSCRIBE = json.dumps({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 1}]})


@pytest.mark.parametrize(
    "frames",
    [
        [SUBSCRIBE] * 5000,
        [os.urandom(60) for _ in range(500)],
        ["[" * 60_000] * 300,
        [b"x" * 1_000_000],
        ["y" * 10_000_000],
    ],
    ids=["flood", "garbage", "nesting", "huge", "huger"],
)
def test_a_hostile_client_is_disconnected_and_the_others_are_served(served, web, frames):
    session, node = served
    output = session.source.create_publisher(Health, "health", topics.ALIVE)
    viewer = session.view(node, "/ema/health")
    assert web.run(hostile(web, node.address, frames)) in (None, 1002, 1006, 1008, 1009, 1013)
    name = os.urandom(8).hex()
    output.publish(Health(actuator_id=name))
    viewer.wait_until_received("/ema/health", lambda message: message.actuator_id == name)
    wait_for_value(node, "clients", 1)
    assert session.view(node, "/ema/health").wait_for("/ema/health")


def test_unsupported_requests_are_refused_with_a_message(served):
    session, node = served
    viewer = session.view(node)
    for request, words in (
        ({"op": "advertise", "channels": []}, "operation 'advertise' is not supported"),
        ({"op": "getParameters", "parameterNames": []}, "'getParameters' is not supported"),
        (
            {"op": "unsubscribe", "subscriptionIds": [-1]},
            "expected subscription and channel numbers",
        ),
        (
            {"op": "subscribe", "subscriptions": [{"id": True}]},
            "expected subscription and channel numbers",
        ),
        ({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 99}]}, "99 does not exist"),
        ([1], "expected a JSON object"),
        ("{", "refused: "),
        (b"\x02abc", "expected a binary playback control"),
    ):
        viewer.send(request)
        wait_for(
            lambda words=words: any(words in item.get("message", "") for item in viewer.reported),
            words,
        )


def test_connections_without_a_request_are_closed(session, web, monkeypatch):
    monkeypatch.setattr(web_server, "_PATIENCE_S", 0.5)
    node = session.dashboard(most_clients=1)
    idle = [socket.create_connection(("127.0.0.1", port_of(node))) for _ in range(60)]

    def refused() -> int:
        count = 0
        for connection in idle:
            connection.setblocking(False)
            try:
                count += connection.recv(1) == b""
            except BlockingIOError:
                continue
            except ConnectionError:
                count += 1
        return count

    try:
        wait_for(lambda: refused() >= 60 - 33, "those beyond the limit to be closed")
        wait_for(lambda: refused() == 60, "the others to be closed")
        assert web.get(node.address)[0] == 200
    finally:
        for connection in idle:
            connection.close()


def deaf_client(port: int) -> socket.socket:
    """Return a connection that requests the page repeatedly and never reads."""
    connection = socket.socket()
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    connection.connect(("127.0.0.1", port))
    connection.setblocking(False)
    with suppress(BlockingIOError):  # the answers exceed the kernel's buffers
        request = f"GET /main.js HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n"
        connection.send(request.encode() * 200)
    return connection


def test_client_that_does_not_read_the_page_does_not_delay_shutdown(session):
    node = session.dashboard()
    with deaf_client(port_of(node)):
        wait_for(lambda: node._web._http.connections, "the connection")
        began_s = time.monotonic()
        node.trigger_shutdown()
        # aiohttp would wait for a minute.
        assert time.monotonic() - began_s < 30.0


def client(most_bytes: int) -> Client:
    unused: Any = None
    return Client(unused, unused, print, most_bytes)


def test_oldest_messages_are_dropped_but_protocol_messages_are_kept():
    async def fill() -> None:
        box = client(100)
        box.take("protocol", droppable=False)
        for number in range(30):
            box.take(bytes([number] * 10), droppable=True)
        box.take(bytes(101), droppable=True)
        assert box.dropped == 22  # 9 of 30 fit next to the 8 characters, and the last never fits
        assert box.waiting_bytes == 98
        assert list(box._protocol) == ["protocol"]
        assert [frame[0] for frame in box._messages] == list(range(21, 30))
        assert not box._ended.done()

    asyncio.run(fill())


def test_client_that_does_not_read_protocol_messages_is_disconnected():
    async def fill() -> None:
        box = client(100)
        box.take("a" * 60, droppable=False)
        box.take("b" * 60, droppable=False)
        assert box._ended.result() == (1013, b"too slow")

    asyncio.run(fill())


def test_new_client_receives_all_kept_messages_beyond_its_buffer(session, web):
    node = session.dashboard(buffer_mb=1.0)
    topic, count = "/ema/unit_history", 40
    viewer = session.view(node)
    wait_for(lambda: topic in viewer.channels, "the channel")
    for number in range(count):  # 100 kB each: four times the buffer, created on request
        message = UnitHistory(actuator_id=str(number), serial_number="x" * 100_000)
        node._hub.keep(topic, str(number), partial(serialize_message, message), 0)
    viewer.subscribe_to(topic)
    viewer.wait_until_received(topic, lambda message: message.actuator_id == str(count - 1))
    received = [message.actuator_id for _, message in viewer.received[topic]]
    # It also receives histories of actuators of other tests, whose health is latched.
    names = [str(number) for number in range(count)]
    assert [name for name in received if name in names] == names
    assert values(node)["dropped messages"] == 0


def printed(node: DashboardNode, request: bytes) -> bytes:
    """Send bytes on a new connection. Return the answer."""
    with socket.create_connection(("127.0.0.1", port_of(node)), timeout=30.0) as connection:
        connection.sendall(request)
        with suppress(ConnectionError):
            return connection.recv(4096)
    return b""


def test_malformed_host_is_refused_and_not_echoed_in_headers(served):
    _, node = served
    for host in (b"localhost:1; script-src *", b"localhost:x", b"localhost\xff", b""):
        answer = printed(node, b"GET / HTTP/1.1\r\nHost: " + host + b"\r\n\r\n")
        assert answer.startswith(b"HTTP/1.1 403 "), answer
        assert b"script-src *" not in answer.partition(b"\r\n\r\n")[0]


def test_malformed_requests_are_counted_and_logged_in_a_line(served, caplog):
    _, node = served
    before = values(node)["refused requests"]
    both = b"GET / HTTP/1.1\r\nContent-Length: 4\r\nTransfer-Encoding: chunked\r\nHost: h\r\n\r\n"
    for request in [both, b"\x16\x03\x01\x02garbage\r\n\r\n"] * 50:
        printed(node, request)
    assert values(node)["refused requests"] >= before + 100
    assert len(caplog.text) < 2000
    assert "Traceback" not in caplog.text


def test_idle_connections_do_not_block_other_clients(session: DashboardSession, web: Web):
    node = session.dashboard(most_clients=4)
    address = "127.0.0.1", port_of(node)
    mute = [socket.create_connection(address) for _ in range(100)]
    try:
        for _ in range(10):
            mute.append(socket.create_connection(address))
            status, _, _ = web.get(f"{node.address}metrics")
            assert status == 200
    finally:
        for connection in mute:
            connection.close()
    assert values(node)["refused requests"] > 0
