"""Where the dashboard listens, who may look, and how much of the machine that may take."""

import ipaddress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ema_core.quantity import check_quantities, quantity, text

_LEAST_TOKEN: Final = 16

DEFAULT_ORIGINS: Final = ("https://app.foxglove.dev",)
"""Origins of pages that may connect beside that of the dashboard itself."""


@dataclass(frozen=True)
class DashboardSettings:
    """What the dashboard serves to whom.

    Raises
    ------
    ValueError
        When a value is impossible, the token or certificate cannot be read, or it would listen
        beyond this machine without both.
    """

    host: str = text(
        "127.0.0.1", "address to listen on; beyond loopback a token and TLS are needed"
    )
    port: int = quantity(8765, "-", 0, 65535, "port to listen on; 0 takes any that is free")
    ports: int = quantity(10, "-", 1, 1000, "ports that are tried from `port` on")
    token_file: str = text("", "file that holds the token which clients have to show; empty: none")
    tls_certificate: str = text("", "PEM file of the certificate; empty: no TLS")
    tls_key: str = text("", "PEM file of the certificate's key")
    most_clients: int = quantity(16, "-", 1, 1000, "clients at the same time")
    archive: str = text("", "folder of the archive whose fleet the page shows; empty: none")
    buffer_mb: float = quantity(
        8.0, "MB", 1.0, 1000.0, "messages that wait for a client; beyond it the oldest are dropped"
    )

    def __post_init__(self) -> None:
        check_quantities(self)
        if bool(self.tls_certificate) != bool(self.tls_key):
            given, missing = ("tls_certificate", "tls_key")
            if self.tls_key:
                given, missing = missing, given
            raise ValueError(
                f"{given} = {getattr(self, given)!r} without {missing}: expected both or none"
            )
        missing = [name for name in ("token_file", "tls_certificate") if not getattr(self, name)]
        if missing and not is_loopback(self.host):
            raise ValueError(
                f"host = {self.host!r} can be reached from other machines: expected a loopback "
                f"address such as 127.0.0.1, or {' and '.join(missing)} as well"
            )

    @property
    def uses_tls(self) -> bool:
        """Whether connections are encrypted."""
        return bool(self.tls_certificate)


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach an address or host name."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def read_token(path: str) -> str:
    """Return the token in a file; empty when there is no file.

    A parameter would not do for the token itself: every node of the graph can read parameters.

    Raises
    ------
    ValueError
        When the file cannot be read, or the token is too short or not one word of ASCII.
    """
    if not path:
        return ""
    try:
        token = Path(path).expanduser().read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"parameter token_file = {path!r} cannot be read: {error}") from error
    if len(token) < _LEAST_TOKEN or not token.isprintable() or " " in token:
        raise ValueError(
            f"parameter token_file = {path!r} holds {len(token)} characters: expected one word of "
            f"at least {_LEAST_TOKEN}, such as `openssl rand -hex 16` prints"
        )
    return token
