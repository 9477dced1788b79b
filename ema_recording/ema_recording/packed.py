"""What a recording has compressed, unpacked within bounds: chunks, messages, whole files.

MCAP compresses chunks, rosbag2 single messages or finished files (``compression_mode``). A few
bytes may unpack to any number of them: chunks and messages are bounded in memory, files on disk.
"""

import shutil
import tempfile
import threading
import weakref
import zlib
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Final

import lz4.frame
import zstandard
from mcap.records import Chunk

PACKED_SUFFIX: Final = ".zstd"
"""What rosbag2 appends to the name of a file that it compresses."""

_MAGIC: Final = zstandard.FRAME_HEADER
_MOST_BYTES: Final = 1 << 29
_MOST_RATIO: Final = 1000
_SMALL_BYTES: Final = 1 << 26
_SPARE_BYTES: Final = 1 << 28
_KEPT_BYTES: Final = 1 << 31
_READ_BYTES: Final = 1 << 20


class PackedError(Exception):
    """Something compressed is damaged, or larger than is taken."""


class UnknownCompressionError(ValueError):
    """Something is compressed in a way that is not read here."""


def is_packed(data: bytes) -> bool:
    """Return whether a message, or a file by how it begins, is compressed.

    No CDR message and no MCAP file begins like a frame of zstd.
    """
    return data.startswith(_MAGIC)


def unpack_message(data: bytes) -> bytes:
    """Return a message that was compressed by itself.

    Raises
    ------
    PackedError
        When it is damaged, or unpacks to more than 512 MiB.
    """
    return _unpack_zstd(data, None)


def check_compression(name: str) -> None:
    """Check how the chunks of a file are compressed, as MCAP names it.

    Raises
    ------
    UnknownCompressionError
        When it is otherwise than by zstd or lz4.
    """
    if name not in _UNPACKERS:
        raise UnknownCompressionError(
            f"has chunks compressed by {name!r}, expected 'zstd', 'lz4' or none; rewrite it by "
            "`mcap compress --compression zstd`"
        )


def unpack_chunk(chunk: Chunk) -> bytes:
    """Return the records in a chunk.

    Raises
    ------
    PackedError
        When it is damaged, or unpacks to more than 512 MiB.
    UnknownCompressionError
        When it is compressed otherwise than by zstd or lz4.
    """
    check_compression(chunk.compression)
    _check_size(chunk.uncompressed_size)
    data = _UNPACKERS[chunk.compression](chunk.data, chunk.uncompressed_size)
    if len(data) != chunk.uncompressed_size:
        raise PackedError(f"{len(data)} bytes where {chunk.uncompressed_size} were packed")
    if chunk.uncompressed_crc and (crc := zlib.crc32(data)) != chunk.uncompressed_crc:
        raise PackedError(f"crc validation failed: {crc} where {chunk.uncompressed_crc} was packed")
    return data


def _check_size(size: int) -> None:
    if size > _MOST_BYTES:
        raise PackedError(f"it unpacks to {size} bytes, expected at most {_MOST_BYTES}")


def _unpack_zstd(data: bytes, size: int | None) -> bytes:
    try:
        # A frame may say any size: it is not taken at its word.
        said = zstandard.get_frame_parameters(data).content_size
        if said != zstandard.CONTENTSIZE_UNKNOWN:
            _check_size(said)
        bound = _MOST_BYTES if size is None else max(size, 1)
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=bound)
    except zstandard.ZstdError as error:
        raise PackedError(str(error)) from error


def _unpack_lz4(data: bytes, size: int) -> bytes:
    try:
        return lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    except (RuntimeError, EOFError) as error:
        raise PackedError(str(error)) from error


_UNPACKERS: Final[dict[str, Callable[[bytes, int], bytes]]] = {
    "": lambda data, _: data,
    "zstd": _unpack_zstd,
    "lz4": _unpack_lz4,
}


class StoredFiles:
    """The files of a recording, to be read at any place.

    One that is compressed is unpacked to a file without a name in the folder for temporary files,
    which ends with the process at the latest. The latest are kept as long as they have not more
    than 2 GiB together; an earlier one is unpacked anew when it is read again.
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._unpacked: OrderedDict[Path, tuple[BinaryIO, int]] = OrderedDict()
        weakref.finalize(self, _close, self._unpacked)

    @contextmanager
    def open(self, path: Path) -> Iterator[BinaryIO]:
        """Open a file; one thread at a time reads those that are unpacked.

        Raises
        ------
        ValueError
            When it is compressed and cannot be unpacked at all, or unpacks to more than 1,000
            times its size or than there is room.
        OSError
            When it cannot be opened.
        """
        with path.open("rb") as file:
            if not is_packed(file.read(len(_MAGIC))):
                yield file
                return
            with self._lock:
                if path not in self._unpacked:
                    file.seek(0)
                    self._keep(path, *_unpack_file(path, file))
                self._unpacked.move_to_end(path)
                yield self._unpacked[path][0]

    def _keep(self, path: Path, file: BinaryIO, size: int) -> None:
        kept = sum(size for _, size in self._unpacked.values())
        while self._unpacked and kept + size > _KEPT_BYTES:
            _, (oldest, oldest_size) = self._unpacked.popitem(last=False)
            oldest.close()
            kept -= oldest_size
        self._unpacked[path] = file, size


def _close(unpacked: OrderedDict[Path, tuple[BinaryIO, int]]) -> None:
    for file, _ in unpacked.values():
        file.close()


def _unpack_file(path: Path, packed: BinaryIO) -> tuple[BinaryIO, int]:
    """Unpack a file as far as it is whole, and return what was unpacked and its size [B]."""
    folder = tempfile.gettempdir()
    most = _MOST_RATIO * path.stat().st_size + _SMALL_BYTES
    room = shutil.disk_usage(folder).free - _SPARE_BYTES
    unpacked = tempfile.TemporaryFile(prefix="ema_bag_")  # noqa: SIM115  closed by its owner
    try:
        size = 0
        reader = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
        remedy = f"if it is as large, unpack it by `zstd -d {path}`"
        try:
            while data := reader.read(_READ_BYTES):
                size += len(data)
                if size > most:
                    raise ValueError(
                        f"{path} unpacks to more than {most} bytes, expected at most "
                        f"{_MOST_RATIO} times its size; {remedy}"
                    )
                if size > room:
                    raise ValueError(
                        f"{path} unpacks to more than the {room} bytes for which there is room in "
                        f"{folder}: set TMPDIR to another folder, or {remedy.partition(', ')[2]}"
                    )
                unpacked.write(data)
        except zstandard.ZstdError as error:
            if not size:
                raise ValueError(
                    f"{path} cannot be unpacked: {error}; expected a file compressed by zstd"
                ) from error
            # What is there is read as any file that is cut off.
        unpacked.flush()
    except BaseException:
        unpacked.close()
        raise
    return unpacked, size
