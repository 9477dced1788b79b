# SPDX-License-Identifier: Apache-2.0
"""Access control of the dashboard: host names, origins of pages, token."""

import hashlib
import hmac
import re
from collections.abc import Iterable
from typing import Final

_MOST_QUOTED: Final = 100  # number of characters quoted from a refused request
_HOST: Final = re.compile(r"(\[[0-9a-fA-F:.]+\]|[\w.-]+)(:[0-9]{1,5})?")
_LOOPBACK_NAMES: Final = frozenset(("localhost", "127.0.0.1", "::1"))


class Access:
    """Access control of requests by their headers.

    Any web page may make a browser connect to this machine, and WebSockets are exempt from the
    same-origin policy; therefore the origin is checked. A foreign host name that resolves to this
    machine would give a foreign page the origin of the dashboard; therefore the host is checked.

    Permitted are loopback and the configured host names, and pages of the configured origins, such
    as ``https://example.org``. Clients must present the token, if there is one.
    """

    def __init__(self, hosts: Iterable[str], origins: Iterable[str], token: str) -> None:
        self._hosts = _LOOPBACK_NAMES | {name.lower() for name in hosts}
        self._origins = frozenset(name.lower().rstrip("/") for name in origins)
        self._token = token

    @property
    def needs_token(self) -> bool:
        """Whether clients must present a token."""
        return bool(self._token)

    @property
    def cookie(self) -> str:
        """Value of the cookie that a browser receives after it has presented the token."""
        return hmac.new(self._token.encode(), b"dashboard cookie", hashlib.sha256).hexdigest()

    def refuses(self, host: str, reached: str, scheme: str, origin: str | None) -> str:
        """Return why a request is refused; empty if it is permitted.

        Parameters
        ----------
        host
            Header ``Host``.
        reached
            Address of this machine at which the request arrived.
        scheme
            Scheme of the request.
        origin
            Header ``Origin``; None if missing, as in requests from programs other than browsers.
        """
        name = host_name(host)
        if not _HOST.fullmatch(host):
            return f"host {host[:_MOST_QUOTED]!r} is invalid: expected a name with an optional port"
        if name not in self._hosts and name != reached:
            quoted = name[:_MOST_QUOTED]
            return f"host {quoted!r} is not permitted: add it to the parameter host_names"
        if origin is not None:
            origin_name = origin.lower().rstrip("/")
            is_same = origin_name == f"{scheme}://{host.lower()}"
            if not is_same and origin_name not in self._origins:
                quoted = origin[:_MOST_QUOTED]
                return (
                    f"origin {quoted!r} is not permitted: add it to the parameter allowed_origins"
                )
        return ""

    def sockets(self, host: str, scheme: str) -> list[str]:
        """Return the WebSocket origins of a page, including behind a proxy that adds TLS."""
        page_origin = f"{scheme}://{host.lower()}"
        secure = f"https://{host.lower()}"
        origins = [page_origin, *[secure] * (secure != page_origin and secure in self._origins)]
        return [origin.replace("http", "ws", 1) for origin in origins]

    def permits(self, *, token: str | None, cookie: str | None) -> bool:
        """Return whether the token or cookie is valid, or no token is needed."""
        if not self._token:
            return True
        return _same(token, self._token) or _same(cookie, self.cookie)


def host_name(host: str) -> str:
    """Return the lower-case host name from a ``Host`` header, without port and brackets."""
    if host.startswith("["):
        return host[1:].partition("]")[0].lower()
    return host.partition(":")[0].lower()


def _same(presented: str | None, expected: str) -> bool:
    if presented is None:
        return False
    # Bytes of a header that are not UTF-8 are surrogates.
    return hmac.compare_digest(presented.encode(errors="surrogateescape"), expected.encode())
