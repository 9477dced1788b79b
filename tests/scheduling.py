# SPDX-License-Identifier: Apache-2.0
"""A test file runs in one process: its fixtures are made once; nodes first, numerics in the end."""

from typing import Any

import pytest
from xdist.scheduler import LoadFileScheduling

# Tests of nodes wait a lot, for processes and timers; the short ones fill up the end.
_FIRST = ("cli", "ros", "harness")


class FileScheduling(LoadFileScheduling):
    """That of xdist, which gives a test that crashes its process to the next one, and so on."""

    def schedule(self) -> None:
        """Give every process work, also one that replaces another."""
        super().schedule()
        # A process runs a test once it knows the next one: what was left may be a single test.
        for node in self.nodes:
            self._reschedule(node)

    def remove_node(self, node: Any) -> str | None:
        """Take up what a process has left, but for the test that crashed it; return that one."""
        units = self.assigned_work[node]
        left = [(unit, test) for unit in units.values() for test, done in unit.items() if not done]
        for unit, test in left[:1]:
            unit[test] = True
        # A process that is given a unit without tests waits for ever.
        for scope in [scope for scope, unit in units.items() if all(unit.values())]:
            del units[scope]
        super().remove_node(node)
        return left[0][1] if left else None


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> FileScheduling:
    """Replace xdist's scheduler."""
    return FileScheduling(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the tests that wait first."""
    items.sort(key=lambda item: not {*_FIRST} & {*item.path.parts})
