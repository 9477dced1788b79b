# SPDX-License-Identifier: Apache-2.0
"""Cost of dashboard clients to the graph: the delay that they add to `health`.

    python benchmarks/dashboard.py [--rounds N] [--tests N] [--json FILE]

Runs an actuator with its monitor and the dashboard as processes. The actuator does not wear: the
actuator of the demo fails after a minute, and then a search takes seven times as long. In turn
there is no client, one that reads, one that does not read, one that floods the dashboard with
garbage, and one that requests the page as fast as it can. Prints the time from the end of a window
to the reception of its `health`, and the excess over the time without clients.
"""

import asyncio
import contextlib
import json
import multiprocessing
import os
import time
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from aiohttp import ClientError, ClientSession
from graph import Graph
from rich.table import Table
from script import Figures, Workers, command, cpu_s
from targets import Row, at_most, grid

from ema_cli.processes.bringup import parameter_file
from ema_interfaces.msg import Health
from ema_ros.stamps import stamp_from_message
from ema_ros.topics import LATCHED_BY_MANY, NAMESPACE

MOST_MS: Final = 10.0
NO_CLIENT: Final = "is not there"
_STATUS: Final = "/ema/dashboard: dashboard"
_PROTOCOLS: Final = ("foxglove.sdk.v1",)


async def _attend(session: ClientSession, url: str, *, reads: bool) -> None:
    """Subscribe to all channels. Then read all messages, or none."""
    async with session.ws_connect(url, protocols=_PROTOCOLS, max_msg_size=0) as connection:
        await connection.receive()
        advertised = json.loads((await connection.receive()).data)["channels"]
        channels = [{"id": item["id"], "channelId": item["id"]} for item in advertised]
        await connection.send_json({"op": "subscribe", "subscriptions": channels})
        if not reads:
            await asyncio.Event().wait()  # aiohttp reads ahead 64 kB at most
        async for _ in connection:
            pass


async def _hostile(session: ClientSession, url: str) -> None:
    request = {"op": "subscribe", "subscriptions": [{"id": n, "channelId": n} for n in range(999)]}
    frames = [json.dumps(request), "[" * 60_000, '{"op": "unsubscribe", "subscriptionIds": [1]}']
    async with session.ws_connect(url, protocols=_PROTOCOLS) as connection:
        while not connection.closed:
            for frame in frames:
                await connection.send_str(frame)
            await connection.send_bytes(os.urandom(1000))


async def _page(session: ClientSession, url: str) -> None:
    async with session.get(url) as answer:
        await answer.read()


CLIENTS: Final[dict[str, Any]] = {
    "reads": lambda session, url: _attend(session, url, reads=True),
    "is slow": lambda session, url: _attend(session, url, reads=False),
    "is hostile": _hostile,
    "reloads": _page,
}


def be_client(kind: str, url: str) -> None:
    """Run a client until the process ends. A refused client reconnects immediately."""
    os.nice(19)  # real clients run on other computers: their own load must not count here

    async def work() -> None:
        async with ClientSession() as session:
            while True:
                with contextlib.suppress(ClientError, ConnectionError):
                    await CLIENTS[kind](session, url)

    asyncio.run(work())


def measure(pool: Workers, rounds: int, tests: int) -> Figures:
    """Measure the delay of health without a client and with each kind of client."""
    delays_s: list[float] = []

    def note(message: Health) -> None:
        delays_s.append(time.time() - 1e-9 * stamp_from_message(message.header.stamp))

    def next_delays_s(count: int) -> list[float]:
        # The first window began before the client connected.
        delays_s.clear()
        graph.wait(lambda: len(delays_s) > count, f"{count} messages on health")
        return delays_s[1 : count + 1]

    results: dict[str, list[float]] = {kind: [] for kind in (NO_CLIENT, *CLIENTS)}
    cores: dict[str, list[float]] = {kind: [] for kind in results}
    context = multiprocessing.get_context("spawn")
    with Graph() as graph:
        graph.listen(Health, f"{NAMESPACE}/health", note, LATCHED_BY_MANY)
        files = [parameter_file("simulated")]
        _, dashboard, _ = (
            graph.start(process, files) for process in ("monitor", "dashboard", "actuator")
        )
        graph.wait_for_status(_STATUS, lambda entry: "address" in entry)
        url = graph.statuses[_STATUS]["address"]
        next_delays_s(2)  # until the kernels are loaded
        for _ in pool.track("rounds", range(rounds)):
            for kind in results:
                client = context.Process(target=be_client, args=(kind, url))
                if kind in CLIENTS:
                    client.start()
                begin_s, used_s = time.monotonic(), cpu_s(dashboard.pid)
                results[kind] += next_delays_s(tests)
                used_s = cpu_s(dashboard.pid) - used_s
                cores[kind].append(used_s / (time.monotonic() - begin_s))
                if kind in CLIENTS:
                    client.kill()
                    client.join()
        graph.wait_for_status(_STATUS, lambda entry: "dropped messages" in entry)
        status = graph.statuses[_STATUS]
    return {
        "delays_s": results,
        "cores": {kind: float(np.mean(values)) for kind, values in cores.items()},
        "dropped": int(status["dropped messages"]),
        "refused": int(status["refused requests"]),
    }


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    medians_ms = {kind: 1e3 * np.median(values) for kind, values in figures["delays_s"].items()}
    for kind in CLIENTS:
        beyond_ms = medians_ms[kind] - medians_ms[NO_CLIENT]
        yield at_most(f"dashboard, a client that {kind}: health later by [ms]", beyond_ms, MOST_MS)


def tables(figures: Figures) -> Iterator[Table | str]:
    """Yield the tables to print below the targets."""
    yield grid(
        f"from window to health, of {len(figures['delays_s'][NO_CLIENT])} each",
        ("a client that", "median [ms]", "95 % [ms]", "dashboard [cores]"),
        (
            (
                kind,
                *(f"{1e3 * np.quantile(values, share):.1f}" for share in (0.5, 0.95)),
                figures["cores"][kind],
            )
            for kind, values in figures["delays_s"].items()
        ),
    )
    yield f"dropped for slow clients: {figures['dropped']} messages"
    yield f"refused: {figures['refused']} requests"


main = command(measure, "dashboard", rows, tables, width=100, rounds=10, tests=3)

if __name__ == "__main__":
    main()
