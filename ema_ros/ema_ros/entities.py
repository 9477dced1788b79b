"""What a node has created, to destroy what a step of its lifecycle has left behind."""

from collections.abc import Collection
from typing import Any

from rclpy.action.server import ActionServer
from rclpy.lifecycle import LifecycleNode
from rclpy.lifecycle.publisher import LifecyclePublisher


def entities_of(node: LifecycleNode) -> list[Any]:
    """Return publishers, subscriptions, services, timers, guard conditions and actions."""
    return [
        *(item for item in node.waitables if isinstance(item, ActionServer)),
        *node.publishers,
        *node.subscriptions,
        *node.services,
        *node.timers,
        *node.guards,
    ]


def destroy_entities(node: LifecycleNode, kept: Collection[Any]) -> int:
    """Destroy what a node has beside ``kept``; return how many that were."""
    known = {id(item) for item in kept}
    # The services of an action are destroyed with it.
    destroyed = 0
    while left := [item for item in entities_of(node) if id(item) not in known]:
        known.add(id(left[0]))
        _destroy(node, left[0])
        destroyed += 1
    return destroyed


def _destroy(node: LifecycleNode, item: Any) -> None:
    if isinstance(item, ActionServer):
        item.destroy()
    elif isinstance(item, LifecyclePublisher):
        node.destroy_lifecycle_publisher(item)
    elif item in list(node.publishers):
        node.destroy_publisher(item)
    elif item in list(node.subscriptions):
        node.destroy_subscription(item)
    elif item in list(node.services):
        node.destroy_service(item)
    elif item in list(node.timers):
        node.destroy_timer(item)
    else:
        node.destroy_guard_condition(item)
