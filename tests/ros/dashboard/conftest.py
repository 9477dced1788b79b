# SPDX-License-Identifier: Apache-2.0
"""A client of the dashboard, and a dashboard with the topics of an actuator."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

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


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("tls")
    certificate, key = folder / "certificate.pem", folder / "key.pem"
    subprocess.run(
        [
            *("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2"),
            *("-subj", "/CN=localhost"),
            *("-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1"),
            *("-out", certificate, "-keyout", key),
        ],
        check=True,
        capture_output=True,
    )
    return certificate, key
