"""What is published while a client subscribes reaches it, whichever comes first."""

import asyncio
import json
import struct
import threading
from collections.abc import Iterator
from typing import Any

import foxglove
import pytest
from aiohttp import ClientSession, WSMsgType
from aiohttp.test_utils import TestServer
from aiohttp.web import Application, Request, WebSocketResponse

from ema_dashboard import channels as channels_module
from ema_dashboard.channels import Channels
from ema_interfaces.msg import Health
from ema_ros import topics

from ...waiting import DEADLINE_S, wait_for
from .client import SUBPROTOCOL, Web

SEVERAL = 1000  # as many subscriptions as a client may ask for at once


class Delay:
    """Between dashboard and server: holds back what the dashboard asks for until it may pass."""

    def __init__(self, web: Web, address: str) -> None:
        self._web = web
        self._address = address
        self.requests: list[Any] = []
        self.may_pass = asyncio.Event()
        application = Application()
        application.router.add_get("/", self._connect)
        self.server = TestServer(application)
        web.run(self.server.start_server())

    def release(self) -> None:
        """Let everything pass from now on."""
        self._web.run(self._release())

    def close(self) -> None:
        self._web.run(self.server.close())

    async def _release(self) -> None:
        self.may_pass.set()

    async def _connect(self, request: Request) -> WebSocketResponse:
        dashboard = WebSocketResponse(protocols=(SUBPROTOCOL,), autoping=False)
        await dashboard.prepare(request)
        async with (
            ClientSession() as session,
            session.ws_connect(self._address, protocols=(SUBPROTOCOL,), autoping=False) as server,
        ):
            back = asyncio.ensure_future(passed(server, dashboard))
            async for message in dashboard:
                self.requests.append(message.data)
                await self.may_pass.wait()
                await pass_on(message, server)
            back.cancel()
        return dashboard


async def passed(source: Any, to: Any) -> None:
    async for message in source:
        await pass_on(message, to)


async def pass_on(message: Any, to: Any) -> None:
    send = {
        WSMsgType.TEXT: to.send_str,
        WSMsgType.BINARY: to.send_bytes,
        WSMsgType.PING: to.ping,
        WSMsgType.PONG: to.pong,
    }
    await send[message.type](message.data)


@pytest.fixture
def delays(web: Web, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Delay]]:
    """Delays before the server of each dashboard of a test."""
    made: list[Delay] = []
    address: Any = vars(Channels)["address"].fget

    def delayed(channels: Channels) -> str:
        if not made:
            made.append(Delay(web, address(channels)))
        return str(made[0].server.make_url("/"))

    monkeypatch.setattr(Channels, "address", property(delayed))
    yield made
    for delay in made:
        delay.close()


def test_a_message_that_comes_before_the_subscription_is_registered_is_not_lost(delays, session):
    output = session.source.create_publisher(Health, "health", topics.LATCHED)
    node = session.dashboard()
    viewer = session.view(node, "/ema/health")
    wait_for(lambda: delays[0].requests, "the request of the subscription")
    channel = viewer.channels["/ema/health"]["id"]
    output.publish(Health(actuator_id="flap"))
    # The server has it now, knows of no subscription, and sends it to nobody.
    wait_for(lambda: node._channels.kept(channel), "the message to be kept")
    assert not node._channels.has_clients("/ema/health")
    delays[0].release()
    [message] = viewer.wait_for("/ema/health")
    assert message.actuator_id == "flap"


def test_what_is_unsubscribed_meanwhile_is_not_sent(delays, session, monkeypatch):
    output = session.source.create_publisher(Health, "health", topics.LATCHED)
    viewer = session.view(session.dashboard(), "/ema/health")
    take, subscriptions = viewer._take_data, set()

    def note(data: bytes) -> None:
        subscriptions.add(struct.unpack_from("<I", data, 1)[0])
        take(data)

    monkeypatch.setattr(viewer, "_take_data", note)
    output.publish(Health(actuator_id="flap"))
    viewer.look_away("/ema/health")
    wait_for(lambda: delays[0].requests, "the request of the subscription")
    delays[0].release()
    viewer.look_at("/ema/health")
    viewer.wait_for("/ema/health")
    assert subscriptions == {2}  # the second one alone


def test_nothing_that_a_client_says_is_passed_on_as_it_is(delays, session):
    viewer = session.view(session.dashboard())
    delays[0].release()
    wait_for(lambda: "/diagnostics" in viewer.channels, "the channel")
    channel = viewer.channels["/diagnostics"]["id"]
    item = {"id": 7, "channelId": channel, "more": "x"}
    viewer.send({"op": "subscribe", "subscriptions": [item], "more": "x"})
    viewer.send({"op": "unsubscribe", "subscriptionIds": [7, 7, 99], "more": "x"})
    wait_for(lambda: len(delays[0].requests) >= 3, "requests, and the ping between them")
    subscribe, _, unsubscribe = delays[0].requests
    item.pop("more")
    assert json.loads(subscribe) == {"op": "subscribe", "subscriptions": [item]}
    assert json.loads(unsubscribe) == {"op": "unsubscribe", "subscriptionIds": [7]}


def test_a_channel_that_a_client_subscribes_to_at_once_is_known(session, monkeypatch):
    asked, answered = threading.Event(), threading.Event()
    kept = Channels.kept

    def noted(channels: Channels, channel_id: int) -> Any:
        asked.set()
        try:
            return kept(channels, channel_id)
        finally:
            answered.set()

    def advertised(topic: str, **options: Any) -> foxglove.Channel:
        channel = foxglove.Channel(topic, **options)
        if topic == "/ema/health":
            assert asked.wait(DEADLINE_S)
            answered.wait(0.5)  # too early an answer; there should be none before this returns
        return channel

    monkeypatch.setattr(Channels, "kept", noted)
    monkeypatch.setattr(channels_module, "Channel", advertised)
    node = session.dashboard()
    viewer = session.view(node)
    output = session.source.create_publisher(Health, "health", topics.LATCHED)
    output.publish(Health(actuator_id="flap"))
    viewer.look_at("/ema/health")
    viewer.wait_for("/ema/health")


def test_the_server_answers_a_ping_when_it_has_registered_what_was_subscribed_before(web):
    # What the relay rests on, a promise of foxglove-sdk's nowhere written down.
    context = foxglove.Context()
    schema = foxglove.Schema(name="a/msg/B", encoding="ros2msg", data=b"int32 a")
    channels = [
        foxglove.Channel(f"/{n}", message_encoding="cdr", schema=schema, context=context)
        for n in range(SEVERAL)
    ]
    server = foxglove.start_server(host="127.0.0.1", port=0, capabilities=[], context=context)
    items = [{"id": n, "channelId": one.id()} for n, one in enumerate(channels, start=1)]

    async def registered() -> int:
        url = f"http://127.0.0.1:{server.port}/"
        async with web.session.ws_connect(url, protocols=(SUBPROTOCOL,), autoping=False) as client:
            await client.send_str(json.dumps({"op": "subscribe", "subscriptions": items}))
            await client.ping(b"1")
            while (await client.receive()).type is not WSMsgType.PONG:
                pass
            return sum(one.has_sinks() for one in channels)

    try:
        for _ in range(10):
            assert web.run(registered()) == SEVERAL
            wait_for(lambda: not channels[-1].has_sinks(), "the client to be gone")
    finally:
        server.stop()
