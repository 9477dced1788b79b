# SPDX-License-Identifier: Apache-2.0
"""A proxy that adds TLS and a path serves page and data of the dashboard."""

import re
import shutil
import socket
import ssl
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from ema_dashboard.dashboard_node import DashboardNode

from ...waiting import started, wait_for
from .client import SUBPROTOCOL, Web
from .session import DashboardSession, wait_for_value

TOKEN = "0123456789abcdef-token"
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "google-chrome"))), None)
NGINX = shutil.which("nginx", path="/usr/sbin:/usr/bin:/sbin")
CONFIGURATION = """
daemon off;
pid {folder}/pid;
error_log {folder}/errors;
events {{ }}
http {{
  access_log off;
  client_body_temp_path {folder}/body;
  proxy_temp_path {folder}/proxy;
  fastcgi_temp_path {folder}/fastcgi;
  uwsgi_temp_path {folder}/uwsgi;
  scgi_temp_path {folder}/scgi;
  types {{ }}
  server {{
    listen 127.0.0.1:{port} ssl;
    ssl_certificate {certificate};
    ssl_certificate_key {key};
    location /hall/ema/ {{
      proxy_pass http://127.0.0.1:{backend}/;
      proxy_http_version 1.1;
      proxy_set_header Host $http_host;
      proxy_set_header Upgrade $http_upgrade;
      proxy_set_header Connection $upgrading;
    }}
  }}
  map $http_upgrade $upgrading {{ default upgrade; '' close; }}
}}
"""

pytestmark = pytest.mark.skipif(NGINX is None, reason="nginx is not installed")


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return listener.getsockname()[1]


@pytest.fixture
def proxied(
    session: DashboardSession, certificate: tuple[Path, Path], tmp_path: Path
) -> Iterator[tuple[DashboardNode, str]]:
    """Yield a dashboard with a token, and its address at a proxy."""
    port, (pem, key) = free_port(), certificate
    (tmp_path / "token").write_text(TOKEN, encoding="ascii")
    node = session.dashboard(
        token_file=str(tmp_path / "token"), allowed_origins=[f"https://127.0.0.1:{port}"]
    )
    backend = int(node.address.rstrip("/").rpartition(":")[2])
    place: dict[str, Any] = {"folder": tmp_path, "port": port, "backend": backend}
    configuration = tmp_path / "nginx.conf"
    configuration.write_text(
        CONFIGURATION.format(certificate=pem, key=key, **place), encoding="utf-8"
    )
    with started([str(NGINX), "-p", str(tmp_path), "-c", str(configuration)]) as process:
        wait_for(lambda: (tmp_path / "pid").exists() or process.poll() is not None, "nginx")
        assert process.poll() is None, "nginx has ended"
        yield node, f"https://127.0.0.1:{port}/hall/ema/"
        session.leave()
        process.terminate()


def trusting(certificate: tuple[Path, Path]) -> ssl.SSLContext:
    return ssl.create_default_context(cafile=str(certificate[0]))


def test_all_addresses_of_the_page_are_below_the_path_of_the_proxy(proxied, certificate, web: Web):
    _, address = proxied
    options: dict[str, Any] = {"ssl": trusting(certificate)}
    status, headers, _ = web.get(f"{address}?token={TOKEN}", **options)
    assert (status, headers["Location"]) == (303, "./")
    cookie = headers["Set-Cookie"].partition(";")[0]
    options["headers"] = {"Cookie": cookie, "Origin": address.partition("/hall")[0]}
    status, headers, page = web.get(address, **options)
    assert status == 200
    host = address.split("/")[2]
    assert f"connect-src 'self' ws://{host} wss://{host};" in headers["Content-Security-Policy"]
    named = re.findall(rb'(?:href|src)="([^"]+)"', page)
    assert len(named) >= 3
    for name in [*(item.decode() for item in named), "worker.js"]:
        assert web.get(address + name, **options)[0] == 200
    status, _, answer = web.get(f"{address}note", "post", json={}, **options)
    assert status == 400, answer


def test_other_origins_are_refused_behind_a_proxy(proxied, certificate, web: Web):
    _, address = proxied
    headers = {"Authorization": f"Bearer {TOKEN}", "Origin": "https://elsewhere.example"}
    assert web.get(address, ssl=trusting(certificate), headers=headers)[0] == 403


def test_data_arrive_through_the_proxy(proxied, certificate, web: Web):
    _, address = proxied
    headers = {"Authorization": f"Bearer {TOKEN}", "Origin": address.partition("/hall")[0]}

    async def connected() -> dict[str, Any]:
        async with web.session.ws_connect(
            address, protocols=(SUBPROTOCOL,), headers=headers, ssl=trusting(certificate)
        ) as connection:
            return await connection.receive_json()

    assert web.run(connected())["op"] == "serverInfo"


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
def test_page_in_a_browser_gets_its_data_through_the_proxy(proxied, tmp_path):
    node, address = proxied
    browser = [
        *(str(CHROMIUM), "--headless", "--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu"),
        *("--ignore-certificate-errors", f"--user-data-dir={tmp_path / 'browser'}"),
        *("--remote-debugging-port=0", f"{address}?token={TOKEN}"),
    ]
    with started(browser, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        wait_for_value(node, "clients", 1)
        process.terminate()
