# SPDX-License-Identifier: Apache-2.0
"""Reservation of ROS domains, so that no two processes on a machine use the same domain."""

import fcntl
import itertools
import os
import tempfile
from contextlib import suppress
from pathlib import Path

# Domains above 101 use ephemeral ports of Linux.
_DOMAINS = range(1, 102)
_FOLDER = Path(tempfile.gettempdir(), "ros_domain_locks")
# Each search starts after the previous domain: a released domain is not reused immediately.
_order = itertools.cycle(_DOMAINS)


class Domain:
    """A ROS domain reserved for this process until released.

    The reservation ends with the process. A child that inherits the lock descriptor (``pass_fds``)
    keeps the reservation while it runs, even if this process was killed.

    Raises
    ------
    RuntimeError
        If all domains are reserved.
    """

    def __init__(self) -> None:
        for number in itertools.islice(_order, len(_DOMAINS)):
            descriptor = _locked(number)
            if descriptor is not None:
                self.number, self.descriptor = number, descriptor
                return
        count = len(_DOMAINS)
        raise RuntimeError(f"all {count} ROS domains are in use ({_FOLDER}): set ROS_DOMAIN_ID")

    def close(self) -> None:
        """Release the domain."""
        os.close(self.descriptor)


def _locked(number: int) -> int | None:
    """Lock a domain and return the lock descriptor, or None if another process holds the lock."""
    _FOLDER.mkdir(exist_ok=True)
    with suppress(PermissionError):  # another user's folder, which is open to all
        _FOLDER.chmod(0o1777)
    path = _FOLDER / f"{number}.lock"
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CREAT, 0o644)
    except PermissionError:  # sticky folders may refuse O_CREAT on the file of another user
        descriptor = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        return None
    return descriptor
