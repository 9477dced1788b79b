# SPDX-License-Identifier: Apache-2.0
"""Graphs under disturbances, recorded and checked by the rules of ``graph_checker``.

A case is one graph under one disturbance at random times: partitions, restarts, jumps of time, slow
subscribers, or four times the load.
"""

import multiprocessing
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any, Final

import numpy as np
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from ema_bags.playback_services import PLAYBACK_SERVICES
from ema_interfaces.msg import FaultEstimate, Health, TelemetryBlock
from ema_ros.stamps import stamp_to_message
from ema_ros.topics import ACTUATOR_TOPICS, LATCHED, NAMESPACE, STREAM

from ..ros.graph import Graph
from .case import Case
from .graph_checker import check
from .graph_record import read_graph

_SETTLED_S: Final = 12.0
_DISTURBED_S: Final = 18.0
"""Time that a graph runs before and after a disturbance [s]: longer than answers may take."""

_BUSY: Final = 4
_ACTUATORS: Final = 4
_TAKES_S: Final = 1.0


def run_condition(case: Case, name: str) -> None:
    """Record a graph under a disturbance, and check its messages."""
    bag = case.folder / "bag"
    with Graph(case.folder / "graph") as graph:
        try:
            CONDITIONS[name](graph, case.rng(), bag)
            graph.wait(_DISTURBED_S)
            end_graph(case, graph, f"{name}: ")
        except AssertionError as error:
            case.fail(f"{name}: {error}")
        for failure in graph.failures():
            case.fail(f"{name}: {failure}")
    check_record(case, bag, f"{name}: ")


def end_graph(case: Case, graph: Graph, what: str = "") -> None:
    """Stop all nodes, the last one first, and record failures to end."""
    for node in reversed(list(graph.processes)):
        code = graph.stop(node)
        case.require(code == 0, f"{what}{node} ended with code {code}")


def check_record(case: Case, bag: Path, what: str = "") -> None:
    """Check the recorded messages of a graph against the rules."""
    check(case, read_graph(bag), what)
    case.require(case.counts["windows"] > 0, f"{what}no window was answered in the record")


def start_actuators(graph: Graph, names: Sequence[str], seeds: Iterable[int]) -> None:
    """Start actuators that publish on the same topics, and wait until each is identified."""
    for number, (name, seed) in enumerate(zip(names, seeds, strict=False)):
        topics = [f"{topic}:={NAMESPACE}/{topic}" for topic in ACTUATOR_TOPICS]
        graph.start(
            "actuator" if len(names) == 1 else f"actuator_{number}",
            "actuator",
            [] if len(names) == 1 else [f"__ns:={NAMESPACE}/{name}", *topics],
            actuator_id=name,
            seed=seed,
        )
    graph.wait_for(
        lambda: {item.actuator_id for item in graph.valid_since(0.0)} >= set(names),
        "a valid estimate of each actuator",
    )


def _begin(graph: Graph, bag: Path, actuators: int = 1) -> None:
    """Start actuators, a monitor and a recorder, and wait until each actuator is identified."""
    names = ["flap"] if actuators == 1 else [f"flap_{number}" for number in range(actuators)]
    graph.start("monitor")
    graph.start("recorder", output=bag)
    start_actuators(graph, names, count())


def _wait_for_estimate(graph: Graph) -> None:
    since_s = time.time()
    graph.wait_for(lambda: graph.valid_since(since_s), "a valid estimate after the disturbance")


def _calm(graph: Graph, rng: np.random.Generator, bag: Path) -> None:
    _begin(graph, bag)
    graph.wait(_SETTLED_S)


def _standstill(victim: str) -> Callable[..., None]:
    def run(graph: Graph, rng: np.random.Generator, bag: Path) -> None:
        _begin(graph, bag)
        graph.wait(rng.uniform(0.3, 1.0) * _SETTLED_S)
        graph.pause(victim)
        # Shorter or longer than the lease of 5 s, after which a node counts as gone.
        graph.wait(rng.uniform(1.0, 9.0))
        graph.resume(victim)
        _wait_for_estimate(graph)

    return run


def _restart(victim: str) -> Callable[..., None]:
    def run(graph: Graph, rng: np.random.Generator, bag: Path) -> None:
        _begin(graph, bag)
        graph.wait(rng.uniform(0.3, 1.0) * _SETTLED_S)
        if rng.random() < 0.5:
            graph.kill(victim)
        else:
            graph.stop(victim)
        graph.wait(rng.uniform(0.0, 4.0))
        graph.start(victim)
        _wait_for_estimate(graph)

    return run


def _clock_jumps(graph: Graph, rng: np.random.Generator, bag: Path) -> None:
    """Play a recorded graph with seeks back and forth, and record monitor and player again."""
    source = bag.with_name("source")
    _begin(graph, source)
    graph.wait(_SETTLED_S)
    for name in ("recorder", "monitor", "actuator"):
        graph.stop(name)
    graph.start("monitor", use_sim_time=True)
    graph.start("recorder", output=bag)
    graph.wait_for(lambda: graph.reports("/ema/monitor: lifecycle", "active"), "the monitor")
    began_s = time.time()
    graph.start("player", bag=source, actuator_only=True, stay=True)
    graph.wait_for(lambda: graph.valid_since(began_s), "an estimate of the replay")
    first_ns = min(sent_ns for sent_ns, _ in graph.blocks)
    seek = PLAYBACK_SERVICES["seek"]
    client = graph.node.create_client(seek, f"{NAMESPACE}/player/seek")
    for _ in range(4):
        # Seek to a random time of the bag.
        to_ns = first_ns + round(1e9 * rng.uniform(0.5, 0.6 * _SETTLED_S))
        request = seek.Request(time=stamp_to_message(to_ns))
        answer = client.call_async(request)
        graph.wait_for(answer.done, "an answer of the player to a seek")
        response: Any = answer.result()
        assert response.success, f"a seek to {to_ns} ns was refused: {response}"
        since_s = time.time()
        graph.wait_for(lambda since_s=since_s: graph.valid_since(since_s), "an estimate")
        graph.wait(rng.uniform(0.0, 2.0))


def _slow_consumers(graph: Graph, rng: np.random.Generator, bag: Path) -> None:
    """Run a graph with reliable subscribers that take one message per second."""
    _begin(graph, bag)
    with _slow_subscribers(graph) as received:
        graph.wait(_SETTLED_S)
    silent = sorted(topic for topic, count in received.items() if not count)
    assert not silent, f"slow consumers received nothing on {', '.join(silent)}"
    _wait_for_estimate(graph)


@contextmanager
def _slow_subscribers(graph: Graph) -> Iterator[Counter[str]]:
    """Take one message per second in a thread. Yield the counts of taken messages by topic."""
    node = Node("slow", namespace="/test", context=graph.node.context)
    received: Counter[str] = Counter()
    ending = threading.Event()

    def taking(topic: str) -> Callable[[Any], None]:
        def take(_: Any) -> None:
            received[topic] += 1
            ending.wait(_TAKES_S)

        return take

    def spin() -> None:
        while not ending.is_set():
            executor.spin_once(timeout_sec=_TAKES_S)

    executor = SingleThreadedExecutor(context=graph.node.context)
    thread = threading.Thread(target=spin, name="slow consumers")
    try:
        for kind, topic, qos in (
            (TelemetryBlock, "telemetry", STREAM),
            (FaultEstimate, "fault_estimate", STREAM),
            (Health, "health", LATCHED),
        ):
            received[topic] = 0
            node.create_subscription(kind, f"{NAMESPACE}/{topic}", taking(topic), qos)
        executor.add_node(node)
        thread.start()
        yield received
    finally:
        ending.set()
        if thread.is_alive():
            thread.join()
        executor.shutdown()
        node.destroy_node()


def _load(graph: Graph, rng: np.random.Generator, bag: Path) -> None:
    """Run a graph with four actuators instead of one, and four processes that load the cores."""
    _begin(graph, bag, _ACTUATORS)
    with _busy(_BUSY):
        graph.wait(_SETTLED_S)
    _wait_for_estimate(graph)


@contextmanager
def _busy(count: int) -> Iterator[None]:
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=_spin, daemon=True) for _ in range(count)]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.join()


def _spin() -> None:
    while True:
        pass


CONDITIONS: Final[dict[str, Callable[[Graph, np.random.Generator, Path], None]]] = {
    "calm": _calm,
    "partition of the publisher": _standstill("actuator"),
    "partition of the monitor": _standstill("monitor"),
    "partition of the recorder": _standstill("recorder"),
    "restart of the monitor": _restart("monitor"),
    "restart of the publisher": _restart("actuator"),
    "clock jumps": _clock_jumps,
    "slow consumers": _slow_consumers,
    "four times the load": _load,
}
"""Disturbances by name."""
