"""The dashboard: what the nodes publish, for Foxglove and for a web page of its own."""

from typing import Any

from ema_ros.managed_node import ManagedNode
from ema_ros.run import run


class DashboardNode(ManagedNode):
    """Serves what the nodes of a namespace publish, and a page that shows it."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("dashboard", **kwargs)


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(DashboardNode, args)


if __name__ == "__main__":
    raise SystemExit(main())
