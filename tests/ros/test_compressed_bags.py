"""Bags that rosbag2 compressed are read as others, within bounds of memory and disk."""

import os
import struct
import tempfile
import tracemalloc
from pathlib import Path

import pytest
import zstandard
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from ema_recording import packed, records
from ema_recording.reader import Bag

from . import compressed
from .test_recording_reader import STRING, N, Written, as_read, record_by_mcap, record_by_us


@pytest.fixture
def files(tmp_path: Path) -> tuple[list[Path], Written]:
    """Two files of a recording, and what is in them."""
    paths = [tmp_path / f"plain_{number}.mcap" for number in range(2)]
    written = [
        item for number, path in enumerate(paths) for item in record_by_us(path, "none", N * number)
    ]
    return paths, written


def test_compressed_messages_are_read(files: tuple[list[Path], Written], tmp_path: Path):
    paths, written = files
    bag = Bag(compressed.by_message(paths[0], tmp_path / "flight"))
    assert as_read(bag) == written[:N]
    assert bag.damage == ""
    # The same is read where the metadata are lost, and of the file alone.
    alone = compressed.by_message(paths[0], tmp_path / "lost", with_metadata=False)
    assert as_read(Bag(alone)) == written[:N]
    assert as_read(Bag(alone / "lost_0.mcap")) == written[:N]


def test_compressed_files_are_read(files: tuple[list[Path], Written], tmp_path: Path):
    paths, written = files
    folder = compressed.by_file(paths, tmp_path / "flight", 2 * N)
    bag = Bag(folder)
    assert as_read(bag) == written
    assert as_read(bag) == written, "a second time"
    assert bag.damage == ""
    assert bag.writers
    assert (bag.start_ns, bag.end_ns) == (0, written[-1][2])
    alone = Bag(folder / "flight_1.mcap.zstd")
    assert as_read(alone) == written[N:]
    (folder / "metadata.yaml").unlink()
    assert as_read(Bag(folder)) == written


@pytest.mark.parametrize("mode", [CompressionMode.MESSAGE, CompressionMode.FILE])
def test_bags_compressed_by_rosbags_are_read(mode: CompressionMode, tmp_path: Path):
    store = get_typestore(Stores.ROS2_JAZZY)
    writer = RosbagsWriter(tmp_path / "flight", version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/t", STRING, typestore=store)
        for number in range(50):
            data = store.serialize_cdr(store.types[STRING](data=str(number)), STRING)
            writer.write(connection, number, data)
    with AnyReader([tmp_path / "flight"]) as reader:
        assert len(list(reader.messages())) == 50
    bag = Bag(tmp_path / "flight")
    assert as_read(bag) == [("/t", str(number), number) for number in range(50)]
    assert bag.damage == ""


def test_file_that_was_unpacked_by_hand_is_taken(files: tuple[list[Path], Written], tmp_path: Path):
    paths, written = files
    folder = compressed.by_file(paths, tmp_path / "flight", 2 * N)
    (folder / "flight_0.mcap").write_bytes(paths[0].read_bytes())
    (folder / "flight_0.mcap.zstd").unlink()
    assert as_read(Bag(folder)) == written
    assert Bag(folder).damage == ""


def test_unpacked_files_leave_nothing_behind_and_are_bounded_together(
    files: tuple[list[Path], Written], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    paths, written = files
    folder = compressed.by_file(paths, tmp_path / "flight", 2 * N)
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    monkeypatch.setattr(packed, "_KEPT_BYTES", paths[0].stat().st_size + 1)
    bag = Bag(folder)
    read = 0
    for item in bag.messages():
        assert (item.topic, item.message.data, item.log_time_ns) == written[read]
        assert len(bag._stored._unpacked) == 1
        assert not any(temporary.iterdir()), "not even while it is read"
        read += 1
    assert read == len(written)
    opened = len(os.listdir("/proc/self/fd"))
    del bag
    assert len(os.listdir("/proc/self/fd")) == opened - 1


def test_truncated_compressed_file_yields_what_is_before_the_cut(
    files: tuple[list[Path], Written], tmp_path: Path
):
    paths, written = files
    folder = compressed.by_file(paths[:1], tmp_path / "flight", N)
    path = folder / "flight_0.mcap.zstd"
    # As zstd hands blocks out while it streams; rosbag2's are of 128 KiB.
    packer = zstandard.ZstdCompressor().compressobj()
    plain = paths[0].read_bytes()
    parts = [
        packer.compress(plain[at : at + 5000]) + packer.flush(zstandard.COMPRESSOBJ_FLUSH_BLOCK)
        for at in range(0, len(plain), 5000)
    ]
    path.write_bytes(b"".join(parts[: len(parts) // 2]))
    bag = Bag(path)
    read = as_read(bag)
    assert N / 4 < len(read) < N
    assert read == written[: len(read)]
    assert f"{len(read)} messages are intact" in bag.damage
    content = path.read_bytes()
    path.write_bytes(content[:3])
    with pytest.raises(ValueError, match=r"flight_0.mcap.zstd is not an MCAP file"):
        Bag(path)
    path.write_bytes(content[:4] + b"no frame of zstd")
    with pytest.raises(ValueError, match=r"mcap.zstd cannot be unpacked: .*compressed by zstd"):
        Bag(path)


def bomb(size: int) -> bytes:
    """Return a frame of zeros."""
    packer = zstandard.ZstdCompressor(level=1).compressobj(size=size)
    block = bytes(1 << 20)
    parts = [packer.compress(block) for _ in range(size >> 20)]
    return b"".join([*parts, packer.flush()])


def test_file_that_unpacks_to_too_much_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(packed, "_SMALL_BYTES", 1 << 20)
    path = tmp_path / "flight_0.mcap.zstd"
    path.write_bytes(bomb(1 << 26))
    with pytest.raises(ValueError, match=r"mcap.zstd unpacks to more than \d+ bytes, .*1000 times"):
        Bag(path)
    monkeypatch.setattr(packed, "_SPARE_BYTES", 1 << 60)
    with pytest.raises(ValueError, match=r"for which there is room in .*: set TMPDIR .*`zstd -d"):
        Bag(path)


def write_one(path: Path, data: bytes, **settings) -> None:
    with path.open("wb") as file:
        writer = Writer(file, **settings)
        writer.start(profile="ros2")
        schema = writer.register_schema(STRING, "ros2msg", b"string data\n")
        channel = writer.register_channel("/t", "cdr", schema)
        writer.add_message(channel, 1, data, 1)
        writer.finish()


def test_message_that_unpacks_to_too_much_is_lost_by_name(tmp_path: Path):
    frame = bomb(1 << 20)
    # What the frame says of its content: 2^40 bytes.
    said = struct.pack("<Q", 1 << 40)
    write_one(tmp_path / "said.mcap", frame[:4] + bytes([0xE0]) + said + frame[9:])
    tracemalloc.start()
    try:
        bag = Bag(tmp_path / "said.mcap")
        assert as_read(bag) == []
        assert tracemalloc.get_traced_memory()[1] < 50_000_000
    finally:
        tracemalloc.stop()
    assert "topic /t: a compressed message is lost: it unpacks to 1099511627776 bytes" in bag.damage
    assert "topic /t: 1 of 1 messages are lost" in bag.damage
    write_one(tmp_path / "no_frame.mcap", b"\x28\xb5\x2f\xfd" + b"no frame")
    bag = Bag(tmp_path / "no_frame.mcap")
    assert as_read(bag) == []
    assert "a compressed message is lost" in bag.damage


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_chunk_that_unpacks_to_more_than_it_says_is_lost_by_name(
    tmp_path: Path, compression: CompressionType, monkeypatch: pytest.MonkeyPatch
):
    path = tmp_path / "flight.mcap"
    record_by_mcap(path, compression=compression)
    monkeypatch.setattr(packed, "_MOST_BYTES", 1000)
    bag = Bag(path)
    assert as_read(bag) == []
    assert "is lost: it unpacks to" in bag.damage
    assert "expected at most 1000" in bag.damage
    # A size that is too small is no licence to unpack more.
    monkeypatch.undo()
    content = bytearray(path.read_bytes())
    offset = next(iter(Bag(path)._files.values())).stretches[0].offset
    content[offset + 9 + 16 : offset + 9 + 24] = struct.pack("<Q", 100)
    path.write_bytes(content)
    bag = Bag(path)
    assert 0 < len(as_read(bag)) < N
    assert f"the chunk at byte {offset} is lost" in bag.damage


def test_unknown_compression_of_chunks_is_refused_with_the_remedy(tmp_path: Path):
    path = tmp_path / "flight.mcap"
    record_by_mcap(path, compression=CompressionType.LZ4)
    content = path.read_bytes().replace(b"\x03\x00\x00\x00lz4", b"\x03\x00\x00\x00lzo")
    for damaged in (content, content[:-1]):  # with an index, and without
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"mcap has chunks compressed by 'lzo', .*`mcap"):
            Bag(path)


def test_record_that_is_too_large_is_not_read_and_an_attachment_is_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = tmp_path / "flight.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, chunk_size=1)
        writer.start(profile="ros2")
        schema = writer.register_schema(STRING, "ros2msg", b"string data\n")
        channel = writer.register_channel("/t", "cdr", schema)
        for number in range(3):
            text = b"x" * (5000 if number == 1 else 10)
            size = struct.pack("<I", len(text) + 1)
            writer.add_message(channel, number, b"\0\1\0\0" + size + text + b"\0", number)
            if not number:
                writer.add_attachment(0, 0, "video", "video/mp4", bytes(10_000))
        writer.finish()
    content = path.read_bytes()
    assert len(as_read(Bag(path))) == 3
    monkeypatch.setattr(records, "_MOST_BYTES", 2000)
    bag = Bag(path)
    assert len(as_read(bag)) == 2
    assert "bytes, expected at most 2000" in bag.damage
    path.write_bytes(content[:-1])  # read through
    bag = Bag(path)
    assert len(as_read(bag)) == 1
    assert "bytes, expected at most 2000" in bag.damage
