"""Where the dashboard listens: its socket, and what encrypts connections."""

import errno
import socket
import ssl


def bound_socket(host: str, port: int, ports: int) -> socket.socket:
    """Return a socket that is bound to the first port that is free.

    Parameters
    ----------
    port
        First port; 0 takes any that is free.
    ports
        Number of ports to try.

    Raises
    ------
    OSError
        When none is free or the address is not one of this machine; the message names it.
    """
    last = min(port + ports, 65536) if port else 1
    failure: OSError | None = None
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
        # Else a restart would find its port in use for a minute.
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        # Connections inherit it: one whose other end is gone or takes nothing ends.
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 30)
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 60_000)
        listener.bind((host, port))
        # Here, as two sockets may be bound to one port as long as none listens.
        listener.listen(64)
    except OSError:
        listener.close()
        raise
    return listener


def tls_context(certificate: str, key: str) -> ssl.SSLContext | None:
    """Return what encrypts connections; None without a certificate.

    Raises
    ------
    ValueError
        When certificate or key cannot be read, or do not belong together.
    """
    if not certificate:
        return None
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(certificate, key)
    except OSError as error:
        raise ValueError(
            f"parameters tls_certificate = {certificate!r} and tls_key = {key!r} are not usable: "
            f"{error}"
        ) from error
    return context
