# SPDX-License-Identifier: Apache-2.0
"""Settings of the dashboard: addresses, access, and limits of resources."""

import errno
import ipaddress
import socket
import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ema_core.files import read_regular_file, require_regular_file
from ema_core.quantity import Checked, quantity, text, texts

_LEAST_TOKEN: Final = 16
_MOST_BYTES: Final = 4096


@dataclass(frozen=True)
class DashboardSettings(Checked):
    """Settings of the dashboard.

    Raises
    ------
    ValueError
        If a value is out of range, or the dashboard would be reachable from other machines
        without token and certificate.
    """

    host: str = text(
        "127.0.0.1",
        "address to listen on; any address other than loopback requires a token and TLS",
    )
    port: int = quantity(8765, "-", 0, 65535, "port to listen on; 0: any free port")
    ports: int = quantity(10, "-", 1, 1000, "number of ports to try, starting at `port`")
    token_file: str = text("", "file with the token that clients must present; empty: no token")
    tls_certificate: str = text("", "PEM file with the certificate; empty: no TLS")
    tls_key: str = text("", "PEM file with the private key of the certificate")
    most_clients: int = quantity(16, "-", 1, 1000, "largest number of simultaneous clients")
    archive: str = text("", "folder of the archive with the fleet to show; empty: none")
    alerts: str = text(
        "", "file with the http(s) address to which level changes are posted; empty: none"
    )
    buffer_mb: float = quantity(
        8.0,
        "MB",
        1.0,
        1000.0,
        ("largest queue of messages for a client; if it is full, the oldest messages are dropped"),
    )

    namespaces: tuple[str, ...] = texts("namespaces to show; empty: the namespace of the node")
    allowed_origins: tuple[str, ...] = texts(
        "origins of other web pages that may connect", ("https://app.foxglove.dev",)
    )
    host_names: tuple[str, ...] = texts(
        "host names of this machine used by clients, in addition to loopback"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.tls_certificate) != bool(self.tls_key):
            present, absent = ("tls_certificate", "tls_key")
            if self.tls_key:
                present, absent = absent, present
            raise ValueError(
                f"{present} = {getattr(self, present)!r} without {absent}: expected both or neither"
            )
        missing = [name for name in ("token_file", "tls_certificate") if not getattr(self, name)]
        if missing and not is_loopback(self.host):
            raise ValueError(
                f"host = {self.host!r} can be reached from other machines: expected a loopback "
                f"address such as 127.0.0.1, or {' and '.join(missing)} as well"
            )


def is_loopback(host: str) -> bool:
    """Return whether an address or host name is reachable only from this machine."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def read_token(path: str) -> str:
    """Read the token from a file; "" without a file. Raises ValueError for an invalid token.

    The token itself is not a parameter, because every node of the graph can read parameters.
    """
    if not path:
        return ""
    token = _content("token_file", path)
    if len(token) < _LEAST_TOKEN or not token.isprintable() or " " in token:
        raise ValueError(
            f"parameter token_file = {path!r} has {len(token)} characters: expected one word of "
            f"at least {_LEAST_TOKEN} characters, such as the output of `openssl rand -hex 16`"
        )
    return token


def read_address(path: str) -> str:
    """Read the address for alerts from a file; "" without a file. Raises ValueError if invalid.

    The address is read from a file because it may be secret.
    """
    if not path:
        return ""
    address = _content("alerts", path)
    if not address.startswith(("http://", "https://")) or len(address.split()) != 1:
        raise ValueError(f"parameter alerts = {path!r}: expected a file with one http(s) address")
    return address


def _content(parameter: str, path: str) -> str:
    try:
        content = read_regular_file(Path(path).expanduser(), _MOST_BYTES)
        return content.decode("ascii").strip()
    except (OSError, ValueError) as error:
        raise ValueError(f"parameter {parameter} = {path!r} cannot be read: {error}") from error


def bound_socket(host: str, port: int, ports: int) -> socket.socket:
    """Return a socket bound to the first free port of a range; port 0 selects any port.

    Raises
    ------
    OSError
        If no port is free, or the address does not belong to this machine.
    """
    last = min(port + ports, 65536) if port else 1
    failure = OSError()
    for number in range(port, last):
        try:
            return _bound(host, number)
        except OSError as error:
            failure = error
            if error.errno != errno.EADDRINUSE:
                break
    tried = f"port {port}" if last == port + 1 else f"ports {port} to {last - 1}"
    raise OSError(f"cannot listen on {tried} of {host}: {failure}") from failure


def _bound(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        # Otherwise the port would be in use for a minute after a restart.
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        # Connections inherit these options: they end if the client is gone or does not receive.
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 30)
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 60_000)
        listener.bind((host, port))
        # Listen here: two sockets may be bound to one port while neither listens.
        listener.listen(64)
    except OSError:
        listener.close()
        raise
    return listener


def tls_context(certificate: str, key: str) -> ssl.SSLContext | None:
    """Return the TLS context; None without a certificate. Raises ValueError if unusable."""
    if not certificate:
        return None
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        for file in filter(None, (certificate, key)):
            require_regular_file(Path(file))
        context.load_cert_chain(certificate, key)
    except (OSError, ValueError) as error:
        raise ValueError(
            f"parameters tls_certificate = {certificate!r} and tls_key = {key!r} are not usable: "
            f"{error}"
        ) from error
    return context
