# SPDX-License-Identifier: Apache-2.0
"""Environment of all tests: an isolated ROS domain, and messages that check their fields."""

import os
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from click.testing import Result

from ema_core.array_environment import array_environment
from ema_core.domains import Domain

from .leftovers import nothing_left
from .orphans import pytest_testnodedown
from .scheduling import pytest_collection_modifyitems, pytest_xdist_make_scheduler

__all__ = ["pytest_collection_modifyitems", "pytest_testnodedown", "pytest_xdist_make_scheduler"]

# In the background of a shell, the tests and the programs that they start would ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Both exist until the process ends. The user's histories and calibrations are not touched.
_domain = Domain()
_home = tempfile.TemporaryDirectory(prefix="ema_ros_home_", ignore_cleanup_errors=True)

os.environ |= {
    "ROS_DOMAIN_ID": str(_domain.number),
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    # Otherwise an int in a float64 field is silently sent as another number.
    "ROS_PYTHON_CHECK_FIELDS": "1",
    "ROS_HOME": _home.name,
    # Participants of one process must not deliver to each other directly.
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(Path(__file__).parents[1] / "tools" / "fastdds.xml"),
    # Threads of numerical libraries in the workers of pytest and their child processes.
    **array_environment(),
}


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option ``--without-ros``, which shows that tests do not need ROS."""
    parser.addoption("--without-ros", action="store_true", help="fail where rclpy is imported")


def pytest_configure(config: pytest.Config) -> None:
    """Make ``import rclpy`` fail with ``--without-ros``."""
    if config.getoption("--without-ros", default=False):
        if "rclpy" in sys.modules:
            raise pytest.UsageError("rclpy is imported already")
        sys.modules["rclpy"] = None  # pyright: ignore[reportArgumentType]


@pytest.fixture(scope="session")
def ema() -> Callable[..., Result]:
    """Return ``commands.ema``, imported here because only these tests need ``ema_cli``."""
    from .commands import ema

    return ema


@pytest.fixture(autouse=True, scope="module")
def _module_leaves_nothing() -> Iterator[None]:
    with nothing_left():
        yield


@pytest.fixture(autouse=True)
def _test_leaves_nothing() -> Iterator[None]:
    with nothing_left():
        yield
