# SPDX-License-Identifier: Apache-2.0
"""Metadata of a recording in the format of rosbag2.

The library rosbags writes metadata only with a whole bag, and cannot read damaged metadata.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml

from ema_bags.recording import CONVERT
from ema_core.yaml_file import load_yaml

PACKED_SUFFIX: Final = ".zstd"
"""Suffix that rosbag2 appends to the name of a compressed file."""

METADATA_FILE = "metadata.yaml"
_ROOT = "rosbag2_bagfile_information"
_VERSION = 9  # of Jazzy: QoS as mappings with named policies
NEVER_NS = 2**63 - 1
"""Start of a recording without a message [ns]."""


@dataclass
class FileInformation:
    """Name, time range and number of messages of a file."""

    name: str
    """Name of the file."""

    start_ns: int = NEVER_NS
    """Log time of the first message [ns]."""

    end_ns: int = 0
    """Log time of the last message [ns]."""

    count: int = 0
    """Number of messages."""

    def add(self, log_time_ns: int) -> None:
        """Count a message."""
        self.start_ns = min(self.start_ns, log_time_ns)
        self.end_ns = max(self.end_ns, log_time_ns)
        self.count += 1

    def extent(self) -> dict[str, Any]:
        """Return start, duration and number of messages in the format of rosbag2."""
        return {
            "starting_time": {"nanoseconds_since_epoch": self.start_ns},
            "duration": {"nanoseconds": max(self.end_ns - self.start_ns, 0)},
            "message_count": self.count,
        }


def bag_information(
    files: Sequence[FileInformation], topics: Iterable[Any], custom_data: Mapping[str, str]
) -> dict[str, Any]:
    """Return the rosbag2 metadata of a recording from its files and topics so far."""
    recording = FileInformation(
        "",
        min((file.start_ns for file in files), default=NEVER_NS),
        max((file.end_ns for file in files), default=0),
        sum(file.count for file in files),
    )
    return {
        "version": _VERSION,
        "storage_identifier": "mcap",
        **recording.extent(),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type_name,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": [topic.qos],
                    "type_description_hash": topic.type_hash,
                },
                "message_count": topic.count,
            }
            for topic in topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [{"path": file.name, **file.extent()} for file in files],
        "custom_data": dict(custom_data) or None,
        "ros_distro": os.environ.get("ROS_DISTRO", ""),
    }


def serialized_metadata(information: dict[str, Any]) -> str:
    """Return the content of the ``rosbag2`` metadata record inside an MCAP file."""
    return yaml.safe_dump(information, sort_keys=False)


def write_metadata(folder: Path, information: dict[str, Any]) -> None:
    """Write ``metadata.yaml`` atomically."""
    part = folder / f"{METADATA_FILE}.part"
    part.write_text(yaml.safe_dump({_ROOT: information}, sort_keys=False), encoding="utf-8")
    part.replace(folder / METADATA_FILE)


@dataclass(frozen=True)
class FolderContents:
    """Files of a recording in a folder."""

    files: list[Path]
    """MCAP files in order."""

    message_count: int | None
    """Number of messages according to the metadata; None if unknown."""

    damage: list[str]
    """Description of each defect."""


def folder_contents(folder: Path) -> FolderContents:
    """Find the files of a recording in a folder, with ``metadata.yaml`` or without.

    Raises
    ------
    FileNotFoundError
        If there is no MCAP file.
    ValueError
        If the storage or compression of the recording is not supported.
    """
    present = _files_in(folder)
    try:
        information = load_yaml(folder / METADATA_FILE)[_ROOT]
        storage, mode = information["storage_identifier"], information["compression_mode"].lower()
        listed = [str(name) for name in information["relative_file_paths"]]
        message_count = int(information["message_count"])
        packing = information["compression_format"] if mode not in ("", "none") else ""
    except FileNotFoundError:
        return _without_metadata(folder, present, f"no {METADATA_FILE}: not closed")
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        reason = f"{METADATA_FILE} cannot be read ({type(error).__name__})"
        return _without_metadata(folder, present, reason)
    if storage != "mcap":
        raise ValueError(f"{folder}: storage is {storage!r}, expected 'mcap'; {CONVERT}")
    if mode not in ("", "none", "message", "file") or packing not in ("", "zstd"):
        raise ValueError(
            f"{folder}: compressed by {packing!r} in mode {mode!r}, expected 'zstd' in mode "
            f"'message' or 'file', or none; {CONVERT}"
        )
    wanted = [Path(name).name.removesuffix(PACKED_SUFFIX) for name in listed]
    missing = [name for name in wanted if name not in present]
    if not wanted or len(missing) == len(wanted):
        raise FileNotFoundError(f"{folder}: {', '.join(missing)} missing from the recording")
    # A file is listed once it is closed.
    later = [name for name in present if _is_later(name, wanted[-1])]
    damage = [f"{name} is missing" for name in missing]
    damage += [f"{name} is not in {METADATA_FILE}: not closed" for name in later]
    files = [present[name] for name in (*wanted, *later) if name in present]
    return FolderContents(files, message_count, damage)


def _files_in(folder: Path) -> dict[str, Path]:
    """Return the MCAP files in a folder in order, keyed by name without the compression suffix.

    An uncompressed file takes precedence: its compressed form is incomplete, or was unpacked.
    """
    files = {
        path.name.removesuffix(PACKED_SUFFIX): path
        for pattern in (f"*.mcap{PACKED_SUFFIX}", "*.mcap")
        for path in folder.glob(pattern)
    }
    return {name: files[name] for name in sorted(files, key=lambda name: (len(name), name))}


def _is_later(name: str, last: str) -> bool:
    """Return whether a file of a split recording has a larger number than the last listed file."""
    stem, separator, number = name.removesuffix(".mcap").rpartition("_")
    last_stem, _, last_number = last.removesuffix(".mcap").rpartition("_")
    numbers = [item for item in (number, last_number) if item.isdecimal()]
    if not separator or stem != last_stem or len(numbers) < 2:
        return False
    return int(number) > int(last_number)


def _without_metadata(folder: Path, present: dict[str, Path], reason: str) -> FolderContents:
    if files := sorted(path.name for path in folder.glob("*.db3*")):
        raise ValueError(f"{folder}: {files[0]} is in sqlite3 storage, expected MCAP; {CONVERT}")
    if not present:
        raise FileNotFoundError(
            f"{folder} is not a recording (a folder with an .mcap file): {reason}"
        )
    return FolderContents(list(present.values()), None, [reason])
