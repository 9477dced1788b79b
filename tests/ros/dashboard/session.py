# SPDX-License-Identifier: Apache-2.0
"""A dashboard in the test process, together with the nodes that it shows."""

from typing import Any

from rclpy.context import Context

from ema_dashboard.dashboard_node import DashboardNode

from ...waiting import wait_for
from ..spinning import Spinning
from .client import Viewer, Web


class DashboardSession(Spinning):
    """The nodes of a test, dashboards that show them, and their clients."""

    def __init__(self, context: Context, web: Web) -> None:
        super().__init__(context)
        self.web = web
        self.viewers: list[Viewer] = []
        self.source = self.node("source")

    def dashboard(self, **parameters: Any) -> DashboardNode:
        """Return an active dashboard, by default at a free port."""
        node = self.unconfigured(**parameters)
        assert node.bring_up()
        return node

    def unconfigured(self, **parameters: Any) -> DashboardNode:
        """Return a dashboard that is not yet configured."""
        return self.managed(DashboardNode, **{"port": 0, **parameters})

    def view(self, node: DashboardNode, *topics: str, **options: Any) -> Viewer:
        """Return a new client that subscribes to topics."""
        viewer = self.web.view(node.address, **options)
        self.viewers.append(viewer)
        viewer.subscribe_to(*topics)
        return viewer

    def leave(self) -> None:
        """Disconnect all clients."""
        while self.viewers:
            self.viewers.pop().close()

    def close(self) -> None:
        self.leave()
        super().close()


def values(node: DashboardNode) -> dict[str, Any]:
    """Return the values in the status of a dashboard."""
    (task,) = node.tasks()
    return dict(task.values)


def wait_for_value(node: DashboardNode, name: str, value: Any) -> None:
    """Wait until an entry in the status of a dashboard has a value."""
    wait_for(lambda: values(node)[name] == value, f"{name} is {value}: {values(node)}")
