"""Bags that rosbag2 compressed are read as others, within bounds of memory and disk."""

from pathlib import Path

import pytest
import zstandard
from mcap.writer import CompressionType
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from ema_bags.metadata import METADATA_FILE
from ema_bags.reader import Bag

from . import compressed
from .test_reader import STRING, N, Written, as_read, record_by_mcap, record_by_us


@pytest.fixture
def files(tmp_path: Path) -> tuple[list[Path], Written]:
    """Two files of a recording, and what is in them."""
    paths = [tmp_path / f"plain_{number}.mcap" for number in range(2)]
    written = [item for number, path in enumerate(paths) for item in record_by_us(path, N * number)]
    return paths, written


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
    written = [("/t", str(number), number) for number in range(50)]
    assert as_read(bag) == written
    assert bag.damage == ""
    # The same is read where the metadata are lost.
    (tmp_path / "flight" / METADATA_FILE).unlink()
    assert as_read(Bag(tmp_path / "flight")) == written


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


def test_unknown_compression_of_chunks_is_refused_with_the_remedy(tmp_path: Path):
    path = tmp_path / "flight.mcap"
    record_by_mcap(path, compression=CompressionType.LZ4)
    content = path.read_bytes().replace(b"\x03\x00\x00\x00lz4", b"\x03\x00\x00\x00lzo")
    for damaged in (content, content[:-1]):  # with an index, and without
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"mcap has chunks compressed by 'lzo', .*`mcap"):
            Bag(path)
