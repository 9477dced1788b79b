"""Bags compressed as ``ros2 bag record --compression-mode message|file`` writes them."""

from pathlib import Path
from typing import Any

import yaml
import zstandard

from ema_bags.metadata import METADATA_FILE


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
