"""A client of the dashboard, and a dashboard with the topics of an actuator."""

from collections.abc import Iterator

import pytest
from rclpy.context import Context

from .client import Web
from .session import DashboardSession


@pytest.fixture(scope="module")
def web() -> Iterator[Web]:
    with Web() as web:
        yield web


@pytest.fixture
def session(context: Context, web: Web) -> Iterator[DashboardSession]:
    session = DashboardSession(context, web)
    yield session
    session.close()
