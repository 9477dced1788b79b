"""A file whose writer never sees a full disk: what does not fit is held until there is room."""

import errno
from collections import deque
from pathlib import Path
from typing import Final

WRITE_BYTES: Final = 64 * 1024
"""How much is gathered for a write [B]."""


class HeldFile:
    """A new file that is written in order; what a write leaves over waits in memory.

    ``write`` takes everything and ``flush`` alone can fail, so that whoever writes through this
    never stops in the middle of a record. A flush that failed can be repeated: it goes on with the
    first byte that is not on the disk.

    Attributes
    ----------
    waiting
        How much is not written yet [B].

    Raises
    ------
    OSError
        When there is such a file, or it cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=0)
        self._parts: deque[bytes] = deque()
        self._written = 0
        self.waiting = 0

    def write(self, data: bytes) -> int:
        """Take data to be written."""
        if data:
            self._parts.append(bytes(data))
            self.waiting += len(data)
        return len(data)

    def tell(self) -> int:
        """Return where the next data will be in the file [B]."""
        return self._written + self.waiting

    def flush(self) -> None:
        """Hand everything to the operating system.

        Raises
        ------
        OSError
            When not all of it could be written; the rest waits.
        """
        while self._parts:
            part = b"".join(self._parts) if self.waiting <= WRITE_BYTES else self._parts[0]
            if len(part) == self.waiting:
                self._parts.clear()
            else:
                self._parts.popleft()
            count = 0
            try:
                count = self._file.write(part) or 0
                if not count:
                    raise OSError(errno.EIO, "nothing was written")
            finally:
                if count < len(part):
                    self._parts.appendleft(part[count:])
                self._written += count
                self.waiting -= count

    def close(self) -> None:
        """Close the file; what waits is lost."""
        self._parts.clear()
        self.waiting = 0
        self._file.close()
