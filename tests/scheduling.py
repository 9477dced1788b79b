# SPDX-License-Identifier: Apache-2.0
"""Schedule of the tests: each file in one process, tests of nodes first, numerics last."""

from typing import Any

import pytest
from xdist.scheduler import LoadFileScheduling

# Tests of nodes wait often, for processes and timers. The short numerical tests fill up the end.
_FIRST = ("cli", "ros", "harness")


class FileScheduling(LoadFileScheduling):
    """Scheduling by file that does not repeat a crashed test.

    xdist would pass a test that crashes its process on to the next process, and so on.
    """

    def schedule(self) -> None:
        """Give work to every process, including a replacement of a crashed process."""
        super().schedule()
        # A process runs a test only when it knows the next one, and a single test may be left.
        for node in self.nodes:
            self._reschedule(node)

    def remove_node(self, node: Any) -> str | None:
        """Return the test that crashed a process, and reassign its remaining tests."""
        units = self.assigned_work[node]
        left = [(unit, test) for unit in units.values() for test, done in unit.items() if not done]
        for unit, test in left[:1]:
            unit[test] = True
        # A process that receives a unit without tests waits forever.
        for scope in [scope for scope, unit in units.items() if all(unit.values())]:
            del units[scope]
        super().remove_node(node)
        return left[0][1] if left else None


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> FileScheduling:
    """Replace xdist's scheduler."""
    return FileScheduling(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sort the tests of nodes to the front."""
    items.sort(key=lambda item: not {*_FIRST} & {*item.path.parts})
