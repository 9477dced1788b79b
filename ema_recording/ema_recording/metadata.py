"""rosbag2's metadata of a recording: written at its end, read for the names of its files.

rosbags writes metadata only with a whole bag, and reads none that is damaged.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml

METADATA_FILE = "metadata.yaml"
_ROOT = "rosbag2_bagfile_information"
_VERSION = 9  # of Jazzy: QoS as mappings in words
NEVER_NS = 2**63 - 1
"""Start of a recording without a message [ns]."""


@dataclass
class TopicInformation:
    """Metadata of a topic; ``qos`` as of :func:`ema_recording.qos.offered_qos`."""

    name: str
    type_name: str
    type_hash: str
    qos: dict[str, Any]
    count: int = 0


def bag_information(
    file_name: str,
    topics: Sequence[TopicInformation],
    start_ns: int,
    end_ns: int,
    custom_data: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, Any]:
    """Return rosbag2's metadata of a recording of one file.

    Parameters
    ----------
    start_ns, end_ns
        Log times of the first and last message [ns]; ``NEVER_NS`` and 0 without any.
    custom_data
        Texts by name.
    """
    count = sum(topic.count for topic in topics)

    def extent() -> dict[str, Any]:
        # Built anew for each use: YAML would write a second use as a reference.
        return {
            "duration": {"nanoseconds": max(end_ns - start_ns, 0)},
            "starting_time": {"nanoseconds_since_epoch": start_ns},
            "message_count": count,
        }

    return {
        "version": _VERSION,
        "storage_identifier": "mcap",
        **extent(),
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
        "relative_file_paths": [file_name],
        "files": [{"path": file_name, **extent()}],
        "custom_data": dict(custom_data) or None,
        "ros_distro": os.environ.get("ROS_DISTRO", ""),
    }


def serialized_metadata(information: dict[str, Any]) -> str:
    """Return the text of the ``rosbag2`` metadata record inside an MCAP file."""
    return yaml.safe_dump(information, sort_keys=False)


def write_metadata(folder: Path, information: dict[str, Any]) -> None:
    """Write ``metadata.yaml``, whole or not at all."""
    part = folder / f"{METADATA_FILE}.part"
    part.write_text(yaml.safe_dump({_ROOT: information}, sort_keys=False), encoding="utf-8")
    part.replace(folder / METADATA_FILE)


@dataclass(frozen=True)
class FolderContents:
    """Files of a recording in a folder.

    Attributes
    ----------
    files
        The MCAP files that are there.
    message_count
        How many messages ``metadata.yaml`` promises; None where it does not say.
    damage
        What is wrong with the folder, one item a finding.
    """

    files: list[Path]
    message_count: int | None
    damage: list[str]


def folder_contents(folder: Path) -> FolderContents:
    """Find the files of a recording in a folder, with ``metadata.yaml`` or without.

    Raises
    ------
    FileNotFoundError
        When there is no MCAP file.
    ValueError
        When the recording is stored or compressed in a way that is not read here.
    """
    present = sorted(folder.glob("*.mcap"))
    try:
        text = (folder / METADATA_FILE).read_text(encoding="utf-8")
        information = yaml.safe_load(text)[_ROOT]
        storage, mode = information["storage_identifier"], information["compression_mode"]
        listed = [folder / Path(name).name for name in information["relative_file_paths"]]
        message_count = int(information["message_count"])
    except FileNotFoundError:
        return _without_metadata(folder, present, f"no {METADATA_FILE}: not closed")
    except (yaml.YAMLError, UnicodeDecodeError, LookupError, TypeError, ValueError) as error:
        reason = f"{METADATA_FILE} cannot be read ({type(error).__name__})"
        return _without_metadata(folder, present, reason)
    if storage != "mcap":
        raise ValueError(f"{folder}: storage is {storage!r}, expected 'mcap'")
    if mode.lower() not in ("", "none"):
        raise ValueError(
            f"{folder}: compressed by {mode}, expected MCAP's own compression or none; rewrite it "
            "by `ros2 bag convert -i BAG -o FILE`, with `output_bags: [{uri: NEW, all: true}]` in "
            "FILE, and record with `--storage-preset-profile zstd_fast`, which does so within MCAP"
        )
    files = [path for path in listed if path.exists()]
    missing = [path.name for path in listed if path not in files]
    if not files:
        raise FileNotFoundError(f"{folder}: {', '.join(missing)} of the recording missing")
    return FolderContents(files, message_count, [f"{name} is missing" for name in missing])


def _without_metadata(folder: Path, present: list[Path], reason: str) -> FolderContents:
    if not present:
        raise FileNotFoundError(f"{folder} is not a recording: {reason}, and no .mcap file")
    return FolderContents(present, None, [reason])
