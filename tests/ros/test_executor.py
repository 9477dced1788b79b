# SPDX-License-Identifier: Apache-2.0
"""One thread runs quick callbacks, others run waiting callbacks; none is run twice."""

import threading
from contextlib import ExitStack
from itertools import pairwise

from std_msgs.msg import Int64
from std_srvs.srv import Trigger

from ema_ros.executor import NodeExecutor, WaitingCallbackGroup

from ..waiting import DEADLINE_S, wait_for
from .spinning import fail, spinning, wait_for_match


def test_messages_are_received_in_order_while_a_service_waits(context, make_node):
    node, peer = make_node("slow"), make_node("peer")
    release = threading.Event()
    begun: list[str] = []
    received: list[tuple[int, str]] = []

    def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        begun.append(threading.current_thread().name)
        response.success = release.wait(DEADLINE_S)
        return response

    node.create_service(Trigger, "wait", serve, callback_group=WaitingCallbackGroup())

    def hear(message: Int64) -> None:
        received.append((message.data, threading.current_thread().name))

    node.create_subscription(Int64, "numbers", hear, 1000)
    client = peer.create_client(Trigger, "wait")
    publisher = peer.create_publisher(Int64, "numbers", 1000)
    with ExitStack() as spun:
        for item in (node, peer):
            spun.enter_context(spinning(NodeExecutor(fail, context=context), item))
        wait_for(client.service_is_ready, "the service")
        wait_for_match(node, publisher)
        answers = [client.call_async(Trigger.Request()) for _ in range(2)]
        wait_for(lambda: begun, "the call")
        for number in range(500):
            publisher.publish(Int64(data=number))
        wait_for(lambda: len(received) == 500, "all messages")
        assert [number for number, _ in received] == list(range(500))
        # One call of the group runs at a time, in a separate thread, and is begun once.
        assert len(begun) == 1
        assert {name for _, name in received}.isdisjoint(begun)
        assert len({name for _, name in received}) == 1
        assert not any(answer.done() for answer in answers)
        release.set()
        wait_for(lambda: all(answer.done() for answer in answers), "the answers")
    assert len(begun) == 2


def test_waiting_messages_are_received_in_bounded_batches(context, make_node):
    """Waiting again for each message would take longer than receiving it."""
    node, peer = make_node("slow"), make_node("peer")
    received: list[int] = []
    failures: list[str] = []

    def hear(message: Int64) -> None:
        received.append(message.data)
        if message.data == 3:
            raise ValueError("three")

    node.create_subscription(Int64, "flood", hear, 1000)
    publisher = peer.create_publisher(Int64, "flood", 1000)
    executor = NodeExecutor(lambda error: failures.append(str(error)), context=context)
    executor.add_node(node)
    wait_for_match(node, publisher)
    for number in range(250):
        publisher.publish(Int64(data=number))
    assert publisher.wait_for_all_acked()
    counts = [0]
    wait_for(lambda: _spin_and_count(executor, received, counts) == 250, "all messages")
    assert received == list(range(250))
    assert failures == ["three"]
    # Other callbacks get their turn at least once in a hundred messages.
    steps = [after - before for before, after in pairwise(counts)]
    assert max(steps) == 100
    assert len([step for step in steps if step]) < 10
    executor.shutdown()


def _spin_and_count(executor: NodeExecutor, received: list[int], counts: list[int]) -> int:
    executor.spin_once(timeout_sec=0.1)
    counts.append(len(received))
    return len(received)
