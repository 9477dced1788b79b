"""From bags and folders of bags to the tests of one unit, in order of time."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Final, Self

from ema_bags.metadata import METADATA_FILE
from ema_bags.reader import Bag
from ema_bags.telemetry import described_actuators
from ema_bags.usage import read_counts
from ema_bags.windows import RecordedWindow
from ema_cli.bags.predicting import Predicting
from ema_cli.bags.source import Source, read_windows, require_windows
from ema_core.description import ActuatorDescription
from ema_monitor.prognosis.duty.flown import FlownDuty
from ema_monitor.prognosis.history_entry import Count
from ema_ros.messages import StampedFaults

CALIBRATION_FILE: Final = "calibration.yaml"
"""Name of the calibration of the unit whose bags lie in the same folder."""

_NAMED: Final = 3


@dataclass(frozen=True)
class UnitRecord:
    """What bags say of the tests of one unit.

    Attributes
    ----------
    description
        The unit as it was described last.
    windows
        Windows of all bags, those that cannot be used included, in order of time.
    counts
        Service life that was counted, in order of time.
    truths
        True faults by test cycle, in order of time, where the bags record them.
    remarks
        What is wrong with a bag, or was passed over.
    bags
        The bag of each window, by the window's last stamp.
    flown
        Duty up to the end of each window, by stamp [ns], in order of time.
    """

    description: ActuatorDescription
    windows: list[RecordedWindow]
    counts: list[Count]
    truths: list[StampedFaults]
    remarks: list[str]
    bags: dict[int, Path] = field(default_factory=dict)
    flown: list[tuple[int, FlownDuty]] = field(default_factory=list)

    def as_known_at(self, hours: float) -> Self:
        """Return what was known of the unit at a service hour [h]."""
        later = min((one.stamp_ns for one in self.counts if one.hours > hours), default=math.inf)
        windows = [window for window in self.windows if window.end_ns < later]
        if not self.counts or not windows:
            raise ValueError(
                f"--at {hours:g}: the bags have no test whose count of hours is so small"
            )
        counts = [count for count in self.counts if count.stamp_ns < later]
        return replace(self, windows=windows, counts=counts)


def find_bags(paths: Iterable[Path]) -> list[Path]:
    """Return the bags that paths name, each once."""
    found: dict[Path, Path] = {}
    for path in paths:
        bags = _bags_in(path)
        if not bags:
            raise ValueError(
                f"{path}: this folder holds no bag, neither *.mcap nor a folder with "
                f"{METADATA_FILE}{_hint(path)}"
            )
        for bag in bags:
            found.setdefault(bag.resolve(), bag)
    return list(found.values())


def read_unit(
    paths: Iterable[Path], source: Source, *, skips_unreadable: bool = False
) -> UnitRecord:
    """Read the tests of one unit from bags."""
    tests: list[tuple[Path, RecordedWindow]] = []
    counts: list[Count] = []
    truths: list[StampedFaults] = []
    remarks: list[str] = []
    flown: list[tuple[int, FlownDuty]] = []
    unit: tuple[Path, ActuatorDescription] | None = None
    for path in find_bags(paths):
        try:
            bag = Bag(path)
            present = described_actuators(bag)
        except (ValueError, OSError) as error:
            if not skips_unreadable or not path.exists():
                raise
            remarks.append(_unreadable(path, error))
            continue
        if source.actuator_id is not None and present and source.actuator_id not in present:
            others = ", ".join(sorted(present))
            remarks.append(f"{path}: passed over, it is of actuator {others}")
            continue
        found = read_windows(path, source, bag=bag, with_duty=True)
        damage = bag.damage
        unit = unit or (path, found.description)
        for one in (*(item.description for item in found.windows), found.description):
            _require_same_unit(unit, (path, one))
        remarks += [f"{path}: {remark}" for remark in found.remarks]
        try:
            require_windows(path, found, source)
        except ValueError as error:
            remarks.append(str(error))
        tests += [(path, item) for item in found.windows]
        truths += found.truths
        flown += found.flown
        counted, wrong = read_counts(bag, found.description)
        counts += counted
        remarks += [f"{path}: {remark}" for remark in wrong]
        if bag.damage != damage:  # found in what was counted
            remarks.append(f"{path}: {bag.damage}")
    if unit is None:
        what = "no bag can be read"
        if source.actuator_id is not None:
            what = f"no bag of actuator {source.actuator_id!r}"
        raise ValueError(f"{what}: {'; '.join(remarks)}")
    if not tests:
        raise ValueError(f"no window to diagnose: {'; '.join(remarks)}")
    # Of two windows of one bag and stamp, the second is a repetition: that is for the history.
    tests.sort(key=lambda test: test[1].end_ns)
    _require_order(tests)
    return UnitRecord(
        tests[-1][1].description,
        [item for _, item in tests],
        sorted(counts, key=lambda count: count.stamp_ns),
        sorted(truths, key=lambda truth: truth.stamp_ns),
        remarks,
        {item.end_ns: path for path, item in tests},
        sorted(flown, key=lambda piece: piece[0]),
    )


def with_calibration_beside(given: Predicting, paths: Iterable[Path]) -> Predicting:
    """Return options that name the calibration beside the bags, where they name none themselves."""
    if given.calibration_file is not None:
        return given
    folders = {bag.parent.resolve(): bag.parent for bag in find_bags(paths)}
    files = [path for folder in folders.values() if (path := folder / CALIBRATION_FILE).is_file()]
    if len(files) > 1:
        raise ValueError(
            f"{files[0]} and {files[1]} both lie beside the bags: choose one with --calibration"
        )
    return replace(given, calibration_file=files[0]) if files else given


def _bags_in(path: Path) -> list[Path]:
    if not path.is_dir() or (path / METADATA_FILE).exists():
        return [path]
    folders = (item.parent for item in path.glob(f"*/{METADATA_FILE}"))
    return sorted([*path.glob("*.mcap"), *path.glob("*.db3"), *folders])


def _unreadable(path: Path, error: ValueError | OSError) -> str:
    words = " ".join(str(error).split())
    return words if str(path) in words else f"{path}: {words}"


def _hint(path: Path) -> str:
    """Return which folders in a folder hold bags, in words."""
    folders = sorted(item for item in path.iterdir() if item.is_dir() and _bags_in(item))
    if not folders:
        return ""
    named = ", ".join(str(folder) for folder in folders[:_NAMED])
    more = f" and {len(folders) - _NAMED} more" if len(folders) > _NAMED else ""
    return f"; bags of a unit may be in {named}{more}: give one of these"


def _require_same_unit(
    unit: tuple[Path, ActuatorDescription], other: tuple[Path, ActuatorDescription]
) -> None:
    (path, first), (other_path, second) = unit, other
    if first.actuator_id != second.actuator_id:
        raise ValueError(
            f"{path} is of actuator {first.actuator_id!r} and {other_path} of "
            f"{second.actuator_id!r}: choose one with --actuator-id"
        )
    if first.serial_number != second.serial_number:
        raise ValueError(
            f"{path} is of actuator {first.actuator_id!r} with serial number "
            f"{first.serial_number!r} and {other_path} with {second.serial_number!r}: a prognosis "
            "is of one unit, give the bags of one alone"
        )


def _require_order(tests: Sequence[tuple[Path, RecordedWindow]]) -> None:
    for (path, one), (other_path, other) in pairwise(tests):
        if path != other_path and other.start_ns < one.end_ns:
            raise ValueError(
                f"{path} and {other_path} both have a window at {one.end_ns * 1e-9:.4f} s: "
                "their stamps must show which test came first"
            )
