"""The parameter ``topics`` of recorder and player."""

from collections.abc import Sequence

from rclpy.node import Node


def topic_names(node: Node, names: Sequence[str]) -> set[str] | None:
    """Return the full names of the chosen topics, None where there is no choice.

    Raises
    ------
    ValueError
        When a name is impossible.
    """
    try:
        return {node.resolve_topic_name(name) for name in names} or None
    except RuntimeError as error:
        raise ValueError(f"parameter topics = {list(names)!r}: {error}") from error
