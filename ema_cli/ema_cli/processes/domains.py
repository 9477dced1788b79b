"""ROS domains, each taken by one process of the machine at a time."""

import fcntl
import itertools
import os
import tempfile
from contextlib import suppress
from pathlib import Path

# Domains above 101 use ports that Linux hands out to other programs.
_DOMAINS = range(1, 102)
_FOLDER = Path(tempfile.gettempdir(), "ros_domain_locks")
# Each search goes on behind the one before: a domain just released is not used again at once.
_order = itertools.cycle(_DOMAINS)


class Domain:
    """A domain that no other process has, until it is released or this process ends.

    A process that is started with the lock's descriptor (``pass_fds``) keeps the domain from
    others for as long as it lives, even when this one was killed.
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
        """Let others use the domain."""
        os.close(self.descriptor)


def _locked(number: int) -> int | None:
    """Return the descriptor of the lock of a domain; None where another process has it."""
    _FOLDER.mkdir(exist_ok=True)
    with suppress(PermissionError):  # it is another user's, who has opened it to all
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
