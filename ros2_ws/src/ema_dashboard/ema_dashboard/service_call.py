# SPDX-License-Identifier: Apache-2.0
"""Service calls from the event loop of the hub."""

import asyncio
from typing import Any, Final

from rclpy.client import Client

from ema_dashboard.hub import Hub

_ANSWER_S: Final = 10.0  # a seek reads the latched messages of the bag


async def call(hub: Hub, client: Client | None, name: str, request: Any) -> None:
    """Call a service. Raises ValueError if it is unavailable, refuses or does not respond."""
    if client is None or not client.service_is_ready():
        raise ValueError(f"service {name} is not available")
    answered = asyncio.Event()
    future = client.call_async(request)
    future.add_done_callback(lambda _: hub.in_loop(answered.set))
    try:
        await asyncio.wait_for(answered.wait(), _ANSWER_S)
    except TimeoutError:
        client.remove_pending_request(future)
        raise ValueError(f"{name} did not respond within {_ANSWER_S:g} s") from None
    response: Any = future.result()
    # Services of rosbag2 do not state the reason of a refusal, and some not even the refusal.
    if not getattr(response, "success", True):
        reason = getattr(response, "message", "refused; the log of its node states the reason")
        raise ValueError(f"{name}: {reason}")
