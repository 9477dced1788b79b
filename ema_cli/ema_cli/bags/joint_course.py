# SPDX-License-Identifier: Apache-2.0
"""Course of a joint: baseline from its healthy records, and comparison of later records."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from ema_bags.inputs.defect_wording import defect_line
from ema_bags.inputs.files import open_input
from ema_bags.inputs.importing import Imported
from ema_cli.bags.healthy_until import HealthyUntil
from ema_cli.bags.records import differs_slightly, imported_by
from ema_cli.bags.robot_files import RobotJoint
from ema_core.dates import has_date, moment
from ema_core.description import ActuatorDescription
from ema_core.levels import STALE
from ema_core.telemetry import Telemetry
from ema_monitor.baselines.progress import refusal_of
from ema_monitor.calibration.joint_calibration import JointCalibration, calibrate_joint
from ema_monitor.diagnosis import identify
from ema_monitor.identification.estimate import Estimate, Verdict
from ema_monitor.intake import Intake
from ema_monitor.joint.comparison import QuantityChange
from ema_monitor.joint.wording import friction_advice
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.quantities import FRICTION
from ema_monitor.unit import Unit
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Defect, TriggerSettings
from ema_monitor.windows.window import Window

_PAUSE_NS: Final = 6_000_000_000  # longer than the rest that ends a record

WORK: Final = TriggerSettings(record_s=60.0, record_rest_s=600.0)
"""Settings for records of ordinary work, as in ``attach.yaml`` of ema_bringup. The long rest lets a
record have several strokes in both directions even if the work pauses."""


@dataclass
class JointCourse:
    """Records of a joint over time."""

    description: ActuatorDescription
    """Description of the joint."""
    is_dated: bool = True
    """Whether the timestamps have a date; otherwise they continue from file to file."""
    calibration: JointCalibration | None = None
    """Baseline from the healthy records; None if it could not be fitted."""
    why_no_baseline: str = ""
    """Why there is no baseline; empty if there is one."""
    healthy: int = 0
    """Number of healthy records."""
    estimates: list[Estimate] = field(default_factory=list)
    """Comparisons and refusals of the later records, in order; skipped records are omitted."""
    outlooks: dict[int, Outlook] = field(default_factory=dict)
    """Health after a later record, keyed by the end of the record [ns]; records that do not change
    health are omitted."""
    remarks: list[str] = field(default_factory=list)
    """Defects of the recordings, and reasons why motion is not used as a record."""
    unread: list[str] = field(default_factory=list)
    """Reasons why recordings were not read; empty if all were read."""

    @property
    def advice(self) -> str:
        """Advice on how to make changes of friction more certain; "" if none is needed."""
        return friction_advice(self.calibration.baseline) if self.calibration else ""

    @property
    def baseline_doubt(self) -> str:
        """Why the healthy records may not be healthy; "" if there is no sign of it."""
        return refusal_of(self.calibration) if self.calibration else ""

    @property
    def level(self) -> int:
        """Level after the latest record; STALE if no record was compared."""
        return self.level_after(max(self.outlooks, default=0))

    def level_after(self, end_ns: int) -> int:
        """Return the level after the record that ends at ``end_ns``; STALE if it has no level."""
        outlook = self.outlooks.get(end_ns)
        return outlook.health.level if outlook else STALE

    @property
    def reason(self) -> str:
        """Reason for the level; empty for OK."""
        if self.why_no_baseline:
            return self.why_no_baseline
        if not self.estimates:
            return "no record after the healthy ones"
        latest = self.estimates[-1]
        outlook = self.outlooks.get(latest.end_ns)
        return outlook.health.reason if outlook else latest.reason

    @property
    def level_since_ns(self) -> int:
        """End of the record with which the current level began [ns]; 0 if there is no level."""
        since_ns = 0
        for end_ns, outlook in reversed(self.outlooks.items()):
            if outlook.health.level != self.level:
                break
            since_ns = end_ns
        return since_ns

    @property
    def valid(self) -> list[Estimate]:
        """Estimates of the records that were compared with the baseline."""
        return [estimate for estimate in self.estimates if estimate.comparison is not None]

    @property
    def friction(self) -> QuantityChange | None:
        """Change of Coulomb friction in the latest compared record; None without such a record."""
        valid = self.valid
        return valid[-1].comparison[FRICTION] if valid and valid[-1].comparison else None

    @property
    def further_changes(self) -> tuple[QuantityChange, ...]:
        """Changed quantities in the latest compared record, except friction."""
        valid = self.valid
        if not valid or valid[-1].comparison is None:
            return ()
        return tuple(item for item in valid[-1].comparison.changed if item.name != FRICTION)


def follow_joint(joint: RobotJoint, until: HealthyUntil) -> JointCourse:
    """Learn the baseline of a joint from its healthy records, and compare the later records.

    Parameters
    ----------
    joint
        The joint. If all its recordings have dates, they are sorted by time.
    until
        End of the healthy records.

    Raises
    ------
    ValueError
        If no recording can be read; the message names the recordings.
    """
    remarks: list[str] = []
    unread: list[str] = []
    records = _imported(joint, remarks, unread)
    described = records[0].description
    course = JointCourse(described, remarks=remarks, unread=unread)
    stamps = [_first_stamp(record) for record in records]
    course.is_dated = all(map(has_date, stamps))
    if course.is_dated:
        order = sorted(range(len(records)), key=stamps.__getitem__)
        records = [records[number] for number in order]
    settings = PrognosisSettings()
    unit = Unit(History(*described.unit_key), settings)
    intake = Intake(described.actuator_id, WORK, described, measures_duty=False)
    healthy: list[Window] = []
    first_ns: int | None = None
    is_learning = True
    for number, segment in enumerate(_segments(intake, records, course)):
        window = segment.window
        first_ns = window.start_ns if first_ns is None else first_ns
        if is_learning and until.includes(window.end_ns, first_ns, number):
            if isinstance(window, Window):
                healthy.append(window)
            continue
        if is_learning:
            is_learning = False
            _learn(course, healthy, first_ns)
            healthy.clear()
        if course.calibration is not None:
            _compare(course, unit, intake, segment, settings)
    if is_learning:
        _learn(course, healthy, first_ns)
    return course


def _first_stamp(record: Imported) -> int:
    """Return the first timestamp of an imported recording [ns]; 0 if it has no samples."""
    first = next(iter(record.blocks()), None)
    return 0 if first is None else first.stamp_ns


def _imported(joint: RobotJoint, remarks: list[str], unread: list[str]) -> list[Imported]:
    """Return a joint's telemetry from each file, resampled to the first file's rate if similar.

    Defects are appended to ``remarks``, and the reasons for unread files to both lists.

    Raises
    ------
    ValueError
        If no file can be read.
    """
    records: list[Imported] = []
    mapping, description = joint.mapping, joint.description
    for path in joint.paths:
        try:
            file = open_input(path, mapping)
            record = imported_by(file, mapping, description)
            if records:
                period = records[0].description.sample_period
                if differs_slightly(record.description.sample_period, period):
                    record = imported_by(file, mapping, description, period)
        except (ValueError, OSError) as error:
            text = str(error)
            unread.append(text if str(path) in text else f"{path}: {text}")
            continue
        lines = map(defect_line, record.defects)
        remarks += [f"{path}: {remark}" for remark in (*file.remarks, *lines)]
        records.append(record)
    if not records:
        raise ValueError("; ".join(unread))
    remarks += unread
    return records


def _segments(
    intake: Intake, records: Iterable[Imported], course: JointCourse
) -> Iterator[Segment]:
    """Yield the records in all recordings. Timestamps without a date continue from file to file."""
    end_ns = 0
    for record in records:
        shift_ns: int | None = None
        for block in record.blocks():
            if shift_ns is None:
                is_behind = not course.is_dated and end_ns and block.stamp_ns <= end_ns
                shift_ns = end_ns + _PAUSE_NS - block.stamp_ns if is_behind else 0
            moved: Telemetry = replace(block, stamp_ns=block.stamp_ns + shift_ns)
            end_ns = max(end_ns, moved.stamp_at(len(moved) - 1))
            yield from _windows(intake.feed(moved), course)
        yield from _windows(intake.finish(), course)


def _windows(events: Iterable[Segment | Defect], course: JointCourse) -> Iterator[Segment]:
    for event in events:
        if isinstance(event, Defect):
            course.remarks.append(event.reason)
        else:
            yield event


def _learn(course: JointCourse, healthy: Sequence[Window], first_ns: int | None) -> None:
    """Fit the baseline of a course to its healthy records.

    If that is impossible, ``why_no_baseline`` of the course states the reason. ``first_ns`` is the
    start of the first record [ns], or None if there is no record.
    """
    course.healthy = len(healthy)
    if first_ns is None:
        course.why_no_baseline = "no record: the recordings have no motion of 2 s or more"
        return
    if not healthy:
        course.why_no_baseline = (
            f"no record ends before --healthy: the first begins at {moment(first_ns)}"
        )
        return
    try:
        course.calibration = calibrate_joint(healthy, course.description)
    except ValueError as error:
        course.why_no_baseline = f"no baseline: {error}"


def _compare(
    course: JointCourse, unit: Unit, intake: Intake, segment: Segment, settings: PrognosisSettings
) -> None:
    """Compare a record with the baseline, and add the result to the course unless it is skipped."""
    assert course.calibration is not None
    estimate = identify(segment.window, segment.description, course.calibration)
    if estimate.verdict == Verdict.SKIPPED:
        return
    course.estimates.append(estimate)
    use = intake.take_use(unit.history.unit, estimate.end_ns)
    outlook = unit.update(estimate, None, settings, *use)
    if outlook is not None:
        course.outlooks[estimate.end_ns] = outlook
