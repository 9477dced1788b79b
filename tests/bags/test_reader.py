# SPDX-License-Identifier: Apache-2.0
"""A recording is read in order up to its damage, and damaged data never become messages."""

import random
import re
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml
import zstandard
from mcap.writer import CompressionType, IndexType, Writer
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore
from std_msgs.msg import Header, String

from ema_bags.gaps import GAP
from ema_bags.metadata import METADATA_FILE
from ema_bags.reader import Bag
from ema_bags.schema import schema_text
from ema_bags.writer import BagWriter

QOS = QoSProfile(depth=10)
STEP_NS = 10_000_000
N = 100
STRING = "std_msgs/msg/String"
Written = list[tuple[str, str, int]]


def text(number: int) -> str:
    return f"message {number} " + str(random.Random(number).getrandbits(2000))


def as_read(bag: Bag) -> Written:
    return [(item.topic, item.message.data, item.log_time_ns) for item in bag.messages()]


def record_by_us(path: Path, first: int = 0) -> Written:
    written = [
        (f"/t{number % 2}", text(number), number * STEP_NS) for number in range(first, first + N)
    ]
    with BagWriter(path, chunk_bytes=5000) as writer:
        for topic in ("/t0", "/t1"):
            writer.add_topic(topic, String, QOS)
        for topic, data, log_time_ns in written:
            writer.write(topic, String(data=data), log_time_ns)
    return written


@contextmanager
def mcap_writer(path: Path, **settings) -> Iterator[Writer]:
    """Open a writer of the mcap library, with settings that rosbag2 offers as presets."""
    with path.open("wb") as file:
        writer = Writer(file, **settings)
        writer.start(profile="ros2")
        yield writer
        writer.finish()


def record_by_mcap(path: Path, **settings) -> Written:
    written = [(f"/t{number % 2}", text(number), number * STEP_NS) for number in range(N)]
    with mcap_writer(path, chunk_size=5000, **settings) as writer:
        schema = writer.register_schema(STRING, "ros2msg", schema_text(STRING).encode())
        channels = [writer.register_channel(f"/t{n}", "cdr", schema) for n in range(2)]
        for number, (_, data, log_time_ns) in enumerate(written):
            content = serialize_message(String(data=data))
            writer.add_message(channels[number % 2], log_time_ns, content, log_time_ns)
    return written


NO_SUMMARY = {
    "index_types": IndexType.NONE,
    "repeat_channels": False,
    "repeat_schemas": False,
    "use_statistics": False,
    "use_summary_offsets": False,
}
RECORDERS: dict[str, Callable[[Path], Written]] = {
    "ours": record_by_us,
    "not compressed": lambda path: record_by_mcap(path, compression=CompressionType.NONE),
    "lz4": lambda path: record_by_mcap(path, compression=CompressionType.LZ4),
    "no checksums": lambda path: record_by_mcap(
        path, compression=CompressionType.NONE, enable_crcs=False
    ),
    "no chunks": lambda path: record_by_mcap(path, use_chunking=False),
    "no summary": lambda path: record_by_mcap(path, **NO_SUMMARY),
    "no message index": lambda path: record_by_mcap(path, index_types=IndexType.CHUNK),
    "no repeated channels": lambda path: record_by_mcap(path, repeat_channels=False),
}


@pytest.mark.parametrize("recorder", RECORDERS)
def test_complete_files_are_read_completely(recorder: str, path: Path):
    written = RECORDERS[recorder](path)
    bag = Bag(path)
    assert as_read(bag) == written
    assert as_read(bag) == written, "a second time"
    assert bag.damage == ""
    assert (bag.start_ns, bag.end_ns) == (0, (N - 1) * STEP_NS)
    assert {topic.count for topic in bag.topics.values()} == {N // 2}
    assert [item.log_time_ns for item in bag.raw_messages(["/t1"])] == [
        log_time_ns for topic, _, log_time_ns in written if topic == "/t1"
    ]


# Without its end, a file has neither summary nor index.
@pytest.mark.parametrize("recorder", ["ours", "not compressed", "lz4", "no checksums", "no chunks"])
def test_truncated_file_gives_all_messages_before_the_cut(recorder: str, path: Path):
    written = RECORDERS[recorder](path)
    whole = path.read_bytes()
    rng = random.Random(20)
    read_counts = []
    for size in [1, 8, 9, len(whole) - 1, *sorted(rng.randrange(1, len(whole)) for _ in range(20))]:
        path.write_bytes(whole[:size])
        bag = Bag(path)
        read = as_read(bag)
        assert read == written[: len(read)]
        assert f"{len(read) or 'no intact'} message" in bag.damage
        assert sum(topic.count for topic in bag.topics.values()) == len(read)
        assert bag.end_ns == (read[-1][2] if read else None)
        read_counts.append(len(read))
    assert read_counts[:3] == [0, 0, 0]
    assert read_counts[3] == N, "only the end of the index was cut off"
    assert read_counts[4:] == sorted(read_counts[4:])
    assert len(set(read_counts)) > 8


@pytest.mark.parametrize("recorder", ["ours", "not compressed"])
def test_flipped_bits_never_give_a_message(recorder: str, path: Path):
    written = RECORDERS[recorder](path)
    whole = path.read_bytes()
    rng = random.Random(21)
    harmed = 0
    for _ in range(60):
        damaged = bytearray(whole)
        damaged[rng.randrange(8, len(whole))] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        bag = Bag(path)
        read = as_read(bag)
        remaining = iter(written)
        assert all(item in remaining for item in read), "in order, and nothing else"
        if len(read) < N:
            harmed += 1
            assert "lost" in bag.damage
    assert harmed > 30


def test_damaged_chunk_is_reported_with_the_lost_messages(path: Path):
    written = record_by_mcap(path, compression=CompressionType.NONE)
    damaged = path.read_bytes().replace(b"message 50 ", b"massage 50 ")
    path.write_bytes(damaged)
    bag = Bag(path)
    assert bag.damage == "", "an indexed file is checked as it is read"
    read = as_read(bag)
    assert ("/t0", text(50), 50 * STEP_NS) not in read
    assert N - 20 < len(read) < N
    assert set(read) < set(written)
    assert "the chunk at byte" in bag.damage
    assert "crc validation failed" in bag.damage
    assert f"topic /t0: {N // 2 - sum(item[0] == '/t0' for item in read)} of 50 " in bag.damage
    assert sum(bag.readable_counts().values()) == len(read)
    # The same messages are lost if the file is read sequentially, as without an index.
    path.write_bytes(damaged[:-1])
    again = Bag(path)
    assert "the chunk at byte" in again.damage
    assert as_read(again) == read


def test_zeros_after_a_power_failure_are_not_records(path: Path):
    written = record_by_us(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2] + bytes(len(whole) // 2))
    bag = Bag(path)
    read = as_read(bag)
    assert 0 < len(read) < N
    assert read == written[: len(read)]
    place = re.search(r"damaged at byte (\d+) of", bag.damage)
    assert place
    assert int(place[1]) <= len(whole) // 2 + 5000, "after the chunk that was cut"


def test_damaged_index_is_not_used(path: Path):
    written = record_by_us(path)
    before, name, after = path.read_bytes().rpartition(b"/t0")
    assert name
    path.write_bytes(before + b"/t9" + after)
    bag = Bag(path)
    assert sorted(bag.topics) == ["/t0", "/t1"]
    assert "its index is damaged; 100 messages are intact" in bag.damage
    assert as_read(bag) == written


def test_messages_come_in_the_order_of_their_log_times(path: Path):
    times = list(range(200))
    random.Random(22).shuffle(times)
    times += [100] * 10
    with BagWriter(path, chunk_bytes=1000) as writer:
        writer.add_topic("/t", String, QOS)
        for number, log_time_ns in enumerate(times):
            writer.write("/t", String(data=str(number)), log_time_ns)
    bag = Bag(path)
    read = [(item.log_time_ns, int(item.message.data)) for item in bag.messages()]
    assert read == sorted((log_time_ns, number) for number, log_time_ns in enumerate(times))
    assert (bag.start_ns, bag.end_ns) == (0, 199)


def test_only_requested_topics_are_decoded(path: Path):
    with mcap_writer(path) as writer:
        unknown = writer.register_schema("no_such/msg/Thing", "ros2msg", b"what is this")
        schema = writer.register_schema(STRING, "ros2msg", schema_text(STRING).encode())
        things = writer.register_channel("/things", "cdr", unknown)
        texts = writer.register_channel("/texts", "cdr", schema)
        notes = writer.register_channel("/notes", "json", schema)
        writer.register_channel("/never", "cdr", unknown)
        for channel, data in ((things, b"12345678"), (notes, b"{}")):
            writer.add_message(channel, 1, data, 1)
        writer.add_message(texts, 2, serialize_message(String(data="known")), 2)
    bag = Bag(path)
    assert [item.message.data for item in bag.messages(["/texts", "/never"])] == ["known"]
    assert [item.message.data for item in bag.messages("/texts")] == ["known"]
    with pytest.raises(ValueError, match=r"/things cannot be decoded: .*no_such/msg/Thing cannot"):
        bag.messages(["/texts", "/things"])
    with pytest.raises(ValueError, match="topic /notes cannot be decoded: it is encoded as 'json'"):
        bag.messages(["/notes"])
    with pytest.raises(ValueError, match="/things"):
        bag.messages()
    assert [item.message for item in bag.raw_messages(["/things"])] == [b"12345678"]
    assert len(list(bag.raw_messages())) == 3


def test_type_that_is_not_installed_is_read_with_the_recorded_definition(path: Path):
    with mcap_writer(path) as writer:
        schema = writer.register_schema("no_such/msg/Thing", "ros2msg", b"float64 x\nfloat64[] y\n")
        channel = writer.register_channel("/things", "cdr", schema)
        data = b"\x00\x01\x00\x00" + struct.pack("<dIxxxxdd", 1.5, 2, 2.5, 3.5)
        writer.add_message(channel, 1, data, 1)
    [item] = Bag(path).messages()
    assert (item.message.x, item.message.y.tolist()) == (1.5, [2.5, 3.5])


@pytest.mark.parametrize("with_hash", [True, False])
def test_type_that_has_changed_is_refused(with_hash: bool, path: Path):
    name = "std_msgs/msg/Header"
    schema = schema_text(name).replace("string frame_id", "string frame")
    with mcap_writer(path) as writer:
        number = writer.register_schema(name, "ros2msg", schema.encode())
        metadata = {"topic_type_hash": "RIHS01_" + "1" * 64} if with_hash else {}
        channel = writer.register_channel("/t", "cdr", number, metadata)
        writer.add_message(channel, 1, serialize_message(Header()), 1)
    bag = Bag(path)
    with pytest.raises(ValueError, match=r"/t .* std_msgs/msg/Header .*\[string frame\]"):
        bag.messages()
    assert len(list(bag.raw_messages())) == 1


def test_invalid_message_is_skipped_counted_and_named(path: Path):
    rng = random.Random(23)
    with BagWriter(path) as writer:
        writer.add_topic("/t", Header, QOS)
        writer.write("/t", Header(frame_id="before"), 6)
        writer.write_serialized("/t", b"\x00\x01\x00\x00\x01", 7)
        for number in range(50):
            # Without a known byte order, no message is valid.
            writer.write_serialized("/t", b"\xff" + rng.randbytes(number), 8 + number)
        writer.write("/t", Header(frame_id="after"), 100)
    bag = Bag(path)
    for _ in range(2):
        assert [item.message.frame_id for item in bag.messages()] == ["before", "after"]
        reported = "topic /t: 51 malformed messages skipped, the first of log time 7 ns: "
        assert reported + "no std_msgs/msg/Header: " in bag.damage
    assert "lost" not in bag.damage


def test_lengths_beyond_signed_64_bits_are_damage(path: Path):
    """Python's files refuse such an offset with an OverflowError."""
    record_by_mcap(path, compression=CompressionType.NONE)
    whole, offset, lengths = path.read_bytes(), 8, 0
    while offset < len(whole) - 8:
        _, content = struct.unpack_from("<BQ", whole, offset)
        damaged = bytearray(whole)
        struct.pack_into("<Q", damaged, offset + 1, 2**63)
        path.write_bytes(damaged)
        bag = Bag(path)
        assert len(as_read(bag)) <= N
        lengths += 1
        offset += 9 + content
    assert lengths > 20


def test_file_that_is_not_a_recording_is_refused(tmp_path: Path):
    (tmp_path / "notes.mcap").write_bytes(b"these are notes")
    with pytest.raises(ValueError, match=r"notes.mcap is not an MCAP file: it starts with b'these"):
        Bag(tmp_path / "notes.mcap")
    for content, remedy in (
        (b"t,x\n0,1\n1,2\n", "ema check"),
        (b"SQLite format 3", "ros2 bag convert"),
    ):
        (tmp_path / "other").write_bytes(content)
        with pytest.raises(ValueError, match=remedy):
            Bag(tmp_path / "other")
    (tmp_path / "empty.mcap").touch()
    with pytest.raises(ValueError, match=r"empty.mcap is an empty file: expected an MCAP file"):
        Bag(tmp_path / "empty.mcap")
    with pytest.raises(FileNotFoundError, match=r"nothing.mcap not found"):
        Bag(tmp_path / "nothing.mcap")
    (tmp_path / "folder").mkdir()
    with pytest.raises(
        FileNotFoundError, match=r"folder is not a recording .a folder with an .mcap file"
    ):
        Bag(tmp_path / "folder")


@pytest.fixture
def split(tmp_path: Path) -> tuple[Path, Written]:
    """Return a recording in two files, as rosbag2 splits them, and its content."""
    folder = tmp_path / "flight"
    folder.mkdir()
    written = record_by_us(folder / "flight_0.mcap")
    written += record_by_us(folder / "flight_1.mcap", first=N)
    write_metadata(folder, ["flight_0.mcap", "flight_1.mcap"], len(written))
    return folder, written


def write_metadata(folder: Path, names: list[str], count: int, **changes: str) -> None:
    """Write the parts of rosbag2's metadata that the reader needs."""
    information = {
        "version": 9,
        "storage_identifier": "mcap",
        "message_count": count,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": names,
    }
    text = yaml.safe_dump({"rosbag2_bagfile_information": information | changes})
    (folder / "metadata.yaml").write_text(text)


def test_folder_with_several_files_is_one_recording(split: tuple[Path, Written]):
    folder, written = split
    bag = Bag(folder)
    assert as_read(bag) == written
    assert bag.damage == ""
    assert bag.topics["/t0"].count == N
    assert (bag.start_ns, bag.end_ns) == (0, (2 * N - 1) * STEP_NS)


def test_folder_with_a_missing_file_gives_the_other_files(split: tuple[Path, Written]):
    folder, written = split
    (folder / "flight_0.mcap").unlink()
    bag = Bag(folder)
    assert as_read(bag) == written[N:]
    assert "flight_0.mcap is missing" in bag.damage
    assert f"lists {2 * N} messages, but {N} were found" in bag.damage
    (folder / "flight_1.mcap").unlink()
    with pytest.raises(
        FileNotFoundError, match=r"flight_0.mcap, flight_1.mcap missing from the recording"
    ):
        Bag(folder)


def test_folder_with_an_invalid_file_gives_the_other_files(split: tuple[Path, Written]):
    folder, written = split
    (folder / "flight_1.mcap").write_bytes(b"")
    bag = Bag(folder)
    assert as_read(bag) == written[:N]
    assert "flight_1.mcap is an empty file" in bag.damage


@pytest.mark.parametrize(
    ("metadata", "reported"),
    [
        (None, "no metadata.yaml: not closed"),
        (b"[" * 100_000, "metadata.yaml cannot be read"),
        (b"rosbag2_bagfile_information:\n  version: 9\n", "metadata.yaml cannot be read"),
        (b"\xff\xfe", "metadata.yaml cannot be read"),
    ],
)
def test_folder_without_valid_metadata_gives_its_files(
    metadata, reported: str, split: tuple[Path, Written]
):
    folder, written = split
    (folder / "metadata.yaml").unlink()
    if metadata is not None:
        (folder / "metadata.yaml").write_bytes(metadata)
    bag = Bag(folder)
    assert as_read(bag) == written
    assert reported in bag.damage


@pytest.mark.parametrize(
    ("change", "reported"),
    [
        ({"storage_identifier": "sqlite3"}, "storage is 'sqlite3', expected 'mcap'"),
        (
            {"compression_mode": "FILE", "compression_format": "lz4"},
            "compressed by 'lz4' in mode 'file', expected 'zstd' .* `ros2 bag convert",
        ),
        ({"compression_mode": "CHUNK", "compression_format": "zstd"}, "in mode 'chunk', expected"),
    ],
)
def test_other_storage_is_refused(change: dict, reported: str, tmp_path: Path):
    (tmp_path / "flight").mkdir()
    write_metadata(tmp_path / "flight", ["flight_0.mcap"], N, **change)
    with pytest.raises(ValueError, match=reported):
        Bag(tmp_path / "flight")


def test_number_of_reported_gaps_is_limited(tmp_path: Path):
    path = tmp_path / "a.mcap"
    values = {"reason": "no room", "start_ns": "1", "end_ns": "2", "messages": "3"}
    with mcap_writer(path) as writer:
        for _ in range(13):
            writer.add_metadata(GAP, values)
    for cut in (0, 1):  # read with the index, and sequentially
        path.write_bytes(path.read_bytes()[: -cut or None])
        gaps = [remark for remark in Bag(path).remarks if "gap" in remark]
        assert len(gaps) == 11
        assert gaps[-1] == "3 more gaps: 9 messages not recorded"


def test_topic_of_two_types_is_refused(path: Path):
    with mcap_writer(path) as writer:
        for name in (STRING, "std_msgs/msg/Header"):
            number = writer.register_schema(name, "ros2msg", schema_text(name).encode())
            writer.register_channel("/t", "cdr", number)
    with pytest.raises(
        ValueError, match=f"topic /t has two types, {STRING} and std_msgs/msg/Header"
    ):
        Bag(path)


def by_file(files: list[Path], folder: Path, count: int) -> Path:
    """Compress each MCAP file of a recording, as ``--compression-mode file`` does."""
    folder.mkdir()
    names = []
    for number, source in enumerate(files):
        names.append(f"{folder.name}_{number}.mcap.zstd")
        content = zstandard.ZstdCompressor(level=1).compress(source.read_bytes())
        (folder / names[-1]).write_bytes(content)
    write_metadata(folder, names, count, compression_format="zstd", compression_mode="FILE")
    return folder


def test_compressed_files_are_read(split: tuple[Path, Written], tmp_path: Path):
    plain, written = split
    folder = by_file(sorted(plain.glob("*.mcap")), tmp_path / "packed", 2 * N)
    bag = Bag(folder)
    assert as_read(bag) == written
    assert as_read(bag) == written, "a second time"
    assert bag.damage == ""
    assert bag.writers
    assert (bag.start_ns, bag.end_ns) == (0, written[-1][2])
    alone = Bag(folder / "packed_1.mcap.zstd")
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
    # The content is the same without the metadata.
    (tmp_path / "flight" / METADATA_FILE).unlink()
    assert as_read(Bag(tmp_path / "flight")) == written


def test_truncated_compressed_file_gives_all_messages_before_the_cut(tmp_path: Path):
    source = tmp_path / "plain.mcap"
    written = record_by_us(source)
    folder = by_file([source], tmp_path / "flight", N)
    path = folder / "flight_0.mcap.zstd"
    # With blocks as in streaming zstd; the blocks of rosbag2 have 128 KiB.
    packer = zstandard.ZstdCompressor().compressobj()
    plain = source.read_bytes()
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


def test_unknown_compression_of_chunks_is_refused_with_the_remedy(path: Path):
    record_by_mcap(path, compression=CompressionType.LZ4)
    content = path.read_bytes().replace(b"\x03\x00\x00\x00lz4", b"\x03\x00\x00\x00lzo")
    for damaged in (content, content[:-1]):  # with an index, and without
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"mcap has chunks compressed by 'lzo', .*`mcap"):
            Bag(path)
