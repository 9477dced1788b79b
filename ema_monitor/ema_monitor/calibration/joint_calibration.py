# SPDX-License-Identifier: Apache-2.0
"""Calibration of a unit whose controller is not modelled: the baseline of its healthy records."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from datetime import UTC, datetime
from functools import cached_property
from typing import Any, ClassVar, Final, NamedTuple, Self

import numpy as np

from ema_core.dates import has_date
from ema_core.description import UNKNOWN_DRIVE, ActuatorDescription
from ema_core.linear import DisplayUnit
from ema_core.parameters import ActuatorParameters
from ema_core.wording import counted
from ema_monitor.calibration.stored import StoredCalibration, numbers
from ema_monitor.joint.baseline import Baseline
from ema_monitor.joint.comparing import Comparer
from ema_monitor.joint.lag import EffortLag
from ema_monitor.joint.learning import learn
from ema_monitor.joint.outliers import outliers
from ema_monitor.joint.record import JointRecord, LabelledRecord
from ema_monitor.joint.shape import COEFFICIENTS, Shape
from ema_monitor.joint.signals import Preparation
from ema_monitor.joint.wording import finding
from ema_monitor.reasons import Difference, PeriodTooLong, Reason
from ema_monitor.windows.window import Window

_USED: Final = ("tau", "k_t", "lead")
_N: Final = len(COEFFICIENTS)
_UNITS: Final = {"A": ("rad", "A.s^2/rad"), "N.m": ("rad", "kg.m^2"), "N": ("m", "kg")}
"""Units of motion and inertia, by unit of the effort."""


class OutlyingRecord(NamedTuple):
    """A healthy record that differs from the other healthy records."""

    stamp_ns: int
    """Timestamp of the record [ns]."""
    finding: str
    """Sentence about the difference from the other records."""
    number: int
    """Index among the healthy records of the baseline, from 0."""

    def __str__(self) -> str:
        if not has_date(self.stamp_ns):
            return f"healthy record {self.number + 1} {self.remark}"
        time = datetime.fromtimestamp(self.stamp_ns // 1_000_000_000, UTC)
        return f"the record of {time:%Y-%m-%d %H:%M:%S} UTC {self.remark}"

    @property
    def remark(self) -> str:
        """Warning without its subject, which is the name of the record."""
        return (
            f"differs from the other healthy records: {self.finding}. Leave it out, or confirm "
            "that the unit was healthy"
        )


@dataclass(frozen=True, eq=False, repr=False)
class JointCalibration(StoredCalibration):
    """Baseline of a unit whose controller is not modelled."""

    FORMAT: ClassVar = "joint_1"

    form = "joint"
    """Name of the form, which needs no compiled kernels."""

    unit_parameters = None
    """Always None: a baseline does not determine parameters of the unit."""

    actuator_id: str
    serial_number: str
    """Identifiers of the calibrated actuator and unit."""
    parameters: ActuatorParameters
    """Parameters from the description. Only gear ratio, torque constant and lead are used, to
    convert between motor, user shaft and rod."""
    sample_period: float
    """Median sample period of the healthy records [s]."""
    speed_measured: bool
    """Whether the speed was measured."""
    effort_unit: str
    """Unit in which the effort was recorded."""
    baseline: Baseline = field(repr=False)
    """Healthy records and the effort model fitted to them."""
    outliers: tuple[OutlyingRecord, ...] = ()
    """Healthy records that differ from the other healthy records. They remain in the baseline."""

    @property
    def windows(self) -> int:
        """Number of healthy records."""
        return len(self.baseline.records)

    @cached_property
    def comparer(self) -> Comparer:
        """Comparer of records with the baseline."""
        unit, scale = self.effort_shown
        return Comparer(self.baseline, unit, scale)

    @property
    def effort_shown(self) -> DisplayUnit:
        """Display unit of the effort; its scale is the effort at 1 A."""
        parameters = self.parameters
        torque = parameters.k_t / parameters.tau
        if self.effort_unit == "N.m":
            return DisplayUnit("N.m", torque)
        if self.effort_unit == "N":  # without a lead, the effort is the force itself
            return DisplayUnit(
                "N", torque * 2.0 * math.pi / parameters.lead if parameters.lead else 1.0
            )
        return DisplayUnit("A", 1.0)

    @property
    def torque_scale(self) -> float:
        """Motor torque for an effort of 1 in the unit of ``effort_shown`` [N.m]."""
        return self.parameters.k_t / self.effort_shown.scale

    @property
    def not_learned(self) -> tuple[str, ...]:
        """Always empty: without a drive model, there are no deviations to learn."""
        return ()

    def __str__(self) -> str:
        dated = set(self.baseline.days) - {0}
        days = f"on {counted(len(dated), 'day')}" if dated else "without a date"
        outliers = f", {counted(len(self.outliers), 'outlier')}" if self.outliers else ""
        return (
            f"calibration {self.calibration_id} of {self.actuator_id} (controller not modelled) "
            f"from {counted(self.windows, 'record')} {days}{outliers}: {self._healthy_text}"
        )

    @property
    def _healthy_text(self) -> str:
        """Formatted healthy coefficients, in the units of effort and motion."""
        baseline, shown = self.baseline, self.effort_shown
        travel = self.parameters.lead / (2.0 * math.pi) if self.parameters.lead else 1.0
        length, mass = _UNITS[shown.unit]
        _, inertia, viscous, load, _ = (shown.scale * baseline.healthy).tolist()
        words = [f"friction {shown.text(baseline.friction)}"]
        if baseline.shape.has_viscous and viscous > 0.0:
            words.append(f"viscous friction {viscous / travel:.4g} {shown.unit}.s/{length}")
        if baseline.shape.has_inertia:
            words.append(f"inertia {inertia / travel:.4g} {mass}")
        return ", ".join([*words, f"constant load {load:.4g} {shown.unit}"])

    def with_labels_of(self, other: "JointCalibration") -> Self:
        """Return the calibration with the labelled records of another calibration.

        Labelled records that belong to the healthy records of this calibration are omitted.
        """
        healthy = self.baseline.records
        kept = [
            labelled
            for labelled in other.baseline.labelled
            if not any(labelled.record.is_same(record) for record in healthy)
        ]
        return replace(self, baseline=self.baseline.with_labels(kept))

    @property
    def residual_text(self) -> str:
        """Formatted standard error of the friction in a healthy record."""
        sigma = math.sqrt(float(np.median(self.baseline.covariances[:, 0, 0])))
        return f"friction of a record ± {100.0 * sigma:.2g} %"

    def of_any_motion(self) -> Self:
        """Return the part of the calibration that is valid under any command: all of it."""
        return self

    def shape_mismatch(self, window: Window) -> Reason | None:
        """Return the reason why the samples of a record cannot be compared, or None.

        Records with different sample rates are filtered to the same band.
        """
        highest = self.baseline.preparation.highest_period
        if window.sample_period <= highest:
            return None
        return PeriodTooLong(window.sample_period, highest)

    def unit_mismatch(self, description: ActuatorDescription) -> tuple[Difference, ...]:
        """Return the differences between a description and the calibrated unit; empty if none."""
        differences: list[Difference] = []
        if description.is_modelled:
            differences.append(("drive", description.drive, UNKNOWN_DRIVE))
        measured = description.acquisition.speed
        if measured != self.speed_measured:
            differences.append(("speed_measured", measured, self.speed_measured))
        return (*differences, *self._differences(description, _USED))

    def _as_mapping(self, *, with_labels: bool) -> dict[str, Any]:
        baseline = self.baseline
        content: dict[str, Any] = {
            "format": self.FORMAT,
            "actuator_id": self.actuator_id,
            "serial_number": self.serial_number,
            "parameters": self.parameters.as_mapping(),
            "sample_period": self.sample_period,
            "speed_measured": self.speed_measured,
            "effort_unit": self.effort_unit,
            "preparation": baseline.preparation._asdict(),
            "shape": asdict(baseline.shape),
            "records": [_record_mapping(record) for record in baseline.records],
        }
        if self.outliers:
            content["outliers"] = [outlier._asdict() for outlier in self.outliers]
        if with_labels and baseline.labelled:
            content["labelled"] = [
                {"state": labelled.state, "record": _record_mapping(labelled.record)}
                for labelled in baseline.labelled
            ]
        return content

    @classmethod
    def _of_mapping(cls, content: dict[str, Any]) -> Self:
        baseline = Baseline(
            _preparation_of(content.pop("preparation")),
            _shape_of(content.pop("shape")),
            tuple(map(_record_of, content.pop("records"))),
            tuple(
                LabelledRecord(str(entry["state"]), _record_of(entry["record"]))
                for entry in content.pop("labelled", [])
            ),
        )
        if not baseline.records:
            raise ValueError("records is empty: expected healthy records")
        content["parameters"] = ActuatorParameters().replace(content["parameters"])
        content["outliers"] = tuple(
            OutlyingRecord(int(entry["stamp_ns"]), str(entry["finding"]), int(entry["number"]))
            for entry in content.get("outliers", [])
        )
        return cls(**content, baseline=baseline)


def calibrate_joint(
    windows: Sequence[Window], description: ActuatorDescription
) -> JointCalibration:
    """Return a calibration of a unit whose controller is not modelled, from healthy records.

    Parameters
    ----------
    windows
        Healthy records, at least one. Measured winding temperatures are used.
    description
        Description of the unit.

    Raises
    ------
    ValueError
        If there is no record, the effort is not measured, two records are identical, no record can
        be used, or the records do not determine the friction.
    """
    if description.acquisition.current == "none":
        raise ValueError(
            "drive = unknown needs a measured current or torque, but acquisition.current is none"
        )
    baseline = learn(
        [window.telemetry for window in windows],
        description,
        temperatures=[winding_temperature(window) for window in windows],
    )
    return JointCalibration(
        actuator_id=description.actuator_id,
        serial_number=description.serial_number,
        parameters=description.parameters,
        sample_period=float(np.median([window.sample_period for window in windows])),
        speed_measured=description.acquisition.speed,
        effort_unit=description.acquisition.effort_unit,
        baseline=baseline,
        outliers=tuple(
            OutlyingRecord(outlier.record.stamp_ns, finding(outlier.comparison), outlier.number)
            for outlier in outliers(baseline)
        ),
    )


def winding_temperature(window: Window) -> float:
    """Return the measured rise of the winding temperature in a record [K]; NaN if not measured."""
    measured = (cause.value for cause in window.measured if cause.name == "winding_temperature")
    return next(measured, math.nan)


def _preparation_of(content: dict[str, Any]) -> Preparation:
    ripples = tuple(map(float, content.pop("ripples", ())))
    return Preparation(**content, ripples=ripples)


def _shape_of(content: dict[str, Any]) -> Shape:
    for name in ("of_inertia", "of_gravity"):
        content[name] = tuple(map(float, content.get(name, ())))
    return Shape(**content)


def _record_mapping(record: JointRecord) -> dict[str, Any]:
    content = {item.name: getattr(record, item.name) for item in fields(JointRecord)}
    rows, columns = np.triu_indices(_N)
    content["values"] = record.values.tolist()
    content["covariance"] = record.covariance[rows, columns].tolist()
    content["parts"] = list(record.parts)
    content["effort_lag"] = [*map(float, record.effort_lag[:3])]
    return {
        name: float(value) if isinstance(value, np.floating) else value
        for name, value in content.items()
    }


def _record_of(content: dict[str, Any]) -> JointRecord:
    values = {**content, "values": numbers("values", content["values"])}
    upper = numbers("covariance", content["covariance"])
    covariance = np.zeros((_N, _N))
    covariance[np.triu_indices(_N)] = upper
    values["covariance"] = covariance + np.triu(covariance, 1).T
    if values["values"].shape != (_N,) or not np.all(np.isfinite(covariance)):
        raise ValueError(f"a record has no {_N} coefficients with a finite covariance")
    values["figures"] = _figures_of(content["figures"])
    values["parts"] = tuple(map(_figures_of, content.get("parts", [])))
    values["effort_lag"] = EffortLag(*content.get("effort_lag", ()))
    return JointRecord(**values)


def _figures_of(content: dict[str, Any]) -> dict[str, float]:
    return {str(name): float(value) for name, value in content.items()}
