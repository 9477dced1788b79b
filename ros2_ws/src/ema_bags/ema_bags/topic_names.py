"""The parameter ``topics`` of recorder and player."""

from rclpy.node import Node


def topic_names(node: Node) -> set[str] | None:
    """Return the full names of the chosen topics; None where there is no choice.

    Raises
    ------
    ValueError
        When the parameter is no list of names.
    """
    names = node.get_parameter("topics").value
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise ValueError(f"parameter topics = {names!r}: expected a list of names")
    try:
        return {node.resolve_topic_name(name) for name in names if name} or None
    except RuntimeError as error:
        raise ValueError(f"parameter topics = {names!r}: {error}") from error
