# SPDX-License-Identifier: Apache-2.0
"""Recordings of a robot: files in order of their names, and the mapping of each of its joints."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from ema_bags.inputs.examine import UNKNOWN_JOINT, examine
from ema_bags.inputs.mapping import ColumnMapping, load_mapping
from ema_bags.metadata import METADATA_FILE
from ema_bags.suffixes import BAGS, TABLES
from ema_core.description import ActuatorDescription


class RobotJoint(NamedTuple):
    """A joint of recordings."""

    mapping: ColumnMapping
    """Mapping of the joint."""
    description: ActuatorDescription
    """Description with the joint's name."""


def find_recordings(paths: Sequence[Path]) -> list[Path]:
    """Return the recordings in files and folders, in the order of their names.

    Numbers in names are ordered by their values: ``run_2`` is before ``run_10``.

    A folder is a bag or a data set, or contains recordings.

    Raises
    ------
    ValueError
        If a path does not exist or holds no recording.
    """
    recordings: list[Path] = []
    for path in paths:
        if not path.exists():
            raise ValueError(f"{path}: there is no such file or folder")
        inside = [path] if _is_recording(path) else list(filter(_is_recording, path.iterdir()))
        if not inside:
            suffixes = ", ".join((*BAGS, *TABLES))
            raise ValueError(f"{path}: this folder holds no recording (a bag, {suffixes})")
        recordings += sorted(inside, key=_numbered)
    return list(dict.fromkeys(recordings))


def _numbered(path: Path) -> list[tuple[int, str]]:
    """Return a key that orders numbers in names by their values."""
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
    """Return the joints of recordings, recognised in the first recording that has any.

    Parameters
    ----------
    paths
        Recordings in order.
    mapping_file
        Mapping; None to recognise the columns.
    joints
        Names of the joints; empty for all.
    effort_unit
        Unit of the effort; None as mapped or recognised.

    Raises
    ------
    ValueError
        If no recording holds a joint.
    """
    mapping = load_mapping(mapping_file) if mapping_file else None
    problems = []
    for path in paths:
        try:
            examination = examine(path, mapping=mapping, joints=joints)
        except ValueError as error:
            problems.append(str(error))
            continue
        recognised = [
            RobotJoint(_with_unit(item.mapping, effort_unit), _named(item.joint or path.stem))
            for item in examination.joints
            if item.mapping is not None
        ]
        if recognised:
            return recognised
    raise ValueError("; ".join(problems))


def _with_unit(mapping: ColumnMapping, effort_unit: str | None) -> ColumnMapping:
    """Return a mapping whose effort has a unit, if one is given."""
    if effort_unit is None or mapping.current is None:
        return mapping
    return replace(mapping, current=replace(mapping.current, unit=effort_unit))


def _named(name: str) -> ActuatorDescription:
    return replace(UNKNOWN_JOINT, actuator_id=name)
