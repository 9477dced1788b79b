"""Bags compressed as ``ros2 bag record --compression-mode message|file`` writes them."""

from pathlib import Path
from typing import Any

import yaml
import zstandard
from mcap.reader import make_reader
from mcap.writer import Writer

from ema_bags.metadata import METADATA_FILE


def by_message(source: Path, folder: Path, *, with_metadata: bool = True) -> Path:
    """Compress each message of an MCAP file by itself."""
    folder.mkdir()
    packer = zstandard.ZstdCompressor(level=1)
    name = f"{folder.name}_0.mcap"
    with source.open("rb") as file, (folder / name).open("wb") as packed:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        writer = Writer(packed)
        writer.start(profile="ros2")
        schemas = {
            number: writer.register_schema(item.name, item.encoding, item.data)
            for number, item in summary.schemas.items()
        }
        channels = {
            number: writer.register_channel(
                item.topic, "cdr", schemas[item.schema_id], dict(item.metadata)
            )
            for number, item in summary.channels.items()
        }
        count = 0
        for _, channel, message in reader.iter_messages():
            writer.add_message(
                channels[channel.id],
                message.log_time,
                packer.compress(message.data),
                message.publish_time,
            )
            count += 1
        writer.finish()
    if with_metadata:
        write_metadata(folder, [name], count, "MESSAGE")
    return folder


def by_file(files: list[Path], folder: Path, count: int) -> Path:
    """Compress each of the MCAP files of a recording; the uncompressed ones are not kept."""
    folder.mkdir()
    names = []
    for number, source in enumerate(files):
        names.append(f"{folder.name}_{number}.mcap.zstd")
        (folder / names[-1]).write_bytes(
            zstandard.ZstdCompressor(level=1).compress(source.read_bytes())
        )
    write_metadata(folder, names, count, "FILE")
    return folder


def write_metadata(folder: Path, names: list[str], count: int, mode: str, **more: Any) -> None:
    """Write what the reader wants of rosbag2's metadata."""
    information = {
        "version": 9,
        "storage_identifier": "mcap",
        "message_count": count,
        "compression_format": "zstd",
        "compression_mode": mode,
        "relative_file_paths": names,
    }
    text = yaml.safe_dump({"rosbag2_bagfile_information": information | more})
    (folder / METADATA_FILE).write_text(text, encoding="utf-8")
