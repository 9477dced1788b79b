# SPDX-License-Identifier: Apache-2.0
"""Recordings of a robot: search for files, and the mapping of each joint in them."""

import re
from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final, NamedTuple

from ema_bags.inputs.bags import is_bag
from ema_bags.inputs.examine import UNKNOWN_JOINT, examine
from ema_bags.inputs.files import open_input
from ema_bags.inputs.mapping import ColumnMapping, load_mapping
from ema_bags.metadata import METADATA_FILE
from ema_bags.suffixes import BAGS, TABLES
from ema_core.description import ActuatorDescription
from ema_ros.actuator_file import load_description

_ACTUATOR_FILE: Final = "actuator.yaml"


class RobotJoint(NamedTuple):
    """A joint with its recordings."""

    mapping: ColumnMapping
    """Mapping of the joint."""
    description: ActuatorDescription
    """Description with the joint's name."""
    paths: list[Path]
    """Recordings that contain the joint, and recordings that cannot be read."""


def find_recordings(paths: Sequence[Path]) -> list[Path]:
    """Return the recordings in files and folders, sorted by name within each folder.

    Numbers in names are ordered by their values: ``run_2`` is before ``run_10``. A folder is a bag
    or a data set, or contains recordings.

    Raises
    ------
    ValueError
        If a path does not exist, or is a folder without recordings.
    """
    recordings: list[Path] = []
    for path in paths:
        if not path.exists():
            raise ValueError(f"{path}: no such file or folder")
        inside = [path] if _is_recording(path) else list(filter(_is_recording, path.iterdir()))
        if not inside:
            suffixes = ", ".join((*BAGS, *TABLES))
            raise ValueError(f"{path}: this folder contains no recording (a bag, {suffixes})")
        recordings += sorted(inside, key=_numbered)
    return list(dict.fromkeys(recordings))


def _numbered(path: Path) -> list[tuple[int, str]]:
    """Return a sort key that orders numbers in names by their values."""
    parts = re.split(r"([0-9]+)", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def _is_recording(path: Path) -> bool:
    if path.is_dir():
        return any((path / name).is_file() for name in (METADATA_FILE, "meta/info.json"))
    return path.is_file() and path.suffix.lower() in (*BAGS, *TABLES)


def joints_of(
    paths: Sequence[Path],
    mapping_file: Path | None,
    joints: Sequence[str],
    effort_unit: str | None = None,
) -> list[RobotJoint]:
    """Return the joints of recordings, each with the mapping from the first recording with it.

    A joint without a name is named after ``actuator.yaml`` next to its recording, else after the
    recording if there is only one, else after the folder. A table with the same columns as an
    earlier table is not examined again: it has the same joints.

    Parameters
    ----------
    paths
        Recordings in order.
    mapping_file
        Mapping; None to recognise the columns.
    joints
        Patterns of the names of the joints, such as ``left/*``; empty for all.
    effort_unit
        Unit of the effort; None for the mapped or recognised unit.

    Raises
    ------
    ValueError
        If no recording contains a joint, or a pattern matches no joint.
    """
    mapping = load_mapping(mapping_file) if mapping_file else None
    recognised: dict[str, RobotJoint] = {}
    with_joint: dict[str, list[Path]] = {}
    columns: dict[tuple[str, ...], list[str]] = {}
    problems, unread = [], []
    for path in paths:
        try:
            header = () if path.is_dir() or is_bag(path) else open_input(path, mapping).names
            names = columns.get(header)
            if names is None:
                examination = examine(path, mapping=mapping)
                names = []
                for item in examination.joints:
                    if item.mapping is not None:
                        described = _described(item.joint, path, is_alone=len(paths) == 1)
                        names.append(described.actuator_id)
                        joint = RobotJoint(_with_unit(item.mapping, effort_unit), described, [])
                        recognised.setdefault(described.actuator_id, joint)
                if header:
                    columns[header] = names
        except (ValueError, OSError) as error:
            problems.append(str(error))
            unread.append(path)
            continue
        for name in names:
            with_joint.setdefault(name, []).append(path)
    if not recognised:
        raise ValueError("; ".join(problems))
    for pattern in joints:
        if not any(fnmatchcase(name, pattern) for name in recognised):
            raise ValueError(
                f"there is no joint {pattern!r}: expected {', '.join(map(repr, recognised))}"
            )
    return [
        joint._replace(paths=[path for path in paths if path in (*with_joint[name], *unread)])
        for name, joint in recognised.items()
        if not joints or any(fnmatchcase(name, pattern) for pattern in joints)
    ]


def _described(joint: str, path: Path, *, is_alone: bool) -> ActuatorDescription:
    """Return the description of a joint in a recording; its drive is unknown."""
    file = path.with_name(_ACTUATOR_FILE)
    described = load_description(file) if file.is_file() else None
    parameters = UNKNOWN_JOINT.parameters
    if described is None:
        folder = path.resolve().parent.name
        return replace(UNKNOWN_JOINT, actuator_id=joint or (path.stem if is_alone else folder))
    if described.drive == UNKNOWN_JOINT.drive:
        parameters = described.parameters
    return replace(
        UNKNOWN_JOINT,
        actuator_id=joint or described.actuator_id,
        serial_number=described.serial_number,
        parameters=parameters,
    )


def _with_unit(mapping: ColumnMapping, effort_unit: str | None) -> ColumnMapping:
    """Return a mapping with the unit of its effort replaced, unless ``effort_unit`` is None."""
    if effort_unit is None or mapping.current is None:
        return mapping
    return replace(mapping, current=replace(mapping.current, unit=effort_unit))
