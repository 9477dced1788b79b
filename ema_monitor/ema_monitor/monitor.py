# SPDX-License-Identifier: Apache-2.0
"""Monitor of one actuator: estimates, health and defects from telemetry, without ROS."""

import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import NoneType

import numpy as np

from ema_core.description import ActuatorDescription
from ema_core.expecting import require_type, value_or_default
from ema_core.telemetry import Telemetry
from ema_core.wording import counted
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibrations import CALIBRATIONS, AnyCalibration
from ema_monitor.diagnosis import Diagnosed, Diagnosis
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.search import Generation
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings
from ema_monitor.intake import Intake
from ema_monitor.model.measurements import MAX_AGE_S
from ema_monitor.prognosis.history import History, history_path
from ema_monitor.prognosis.history_entry import Count
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Defect, TriggerSettings

Output = Defect | Diagnosed | Outlook
"""Defect of the telemetry, estimate (or refusal) of a window, or outlook after a test."""


@dataclass(frozen=True)
class MonitorSettings:
    """Settings of a monitor of one actuator.

    Raises
    ------
    ValueError
        If the settings of a part have a wrong type.
    """

    trigger: TriggerSettings = field(default_factory=TriggerSettings)
    """Trigger settings: start condition and length of a window."""

    search: SearchSettings = field(default_factory=SearchSettings)
    """Settings of the fault search."""

    combining: CombinationSettings = field(default_factory=CombinationSettings)
    """Settings of the combination of ordinary motion."""

    prognosis: PrognosisSettings = field(default_factory=PrognosisSettings)
    """Limits, requirements and growth model for health and remaining life."""

    measured_max_age_s: float = MAX_AGE_S
    """Largest age of a measurement at the start of a window [s]."""

    def __post_init__(self) -> None:
        require_type("trigger", self.trigger, TriggerSettings)
        require_type("search", self.search, SearchSettings)
        require_type("combining", self.combining, CombinationSettings)
        require_type("prognosis", self.prognosis, PrognosisSettings)


class Monitor:
    """Monitors one actuator: finds and diagnoses its windows, and records the tests of its unit.

    The monitor node uses the same parts in several threads.

    Parameters
    ----------
    description
        The actuator; the built-in actuator by default.
    calibration
        Its calibration; the shipped calibration by default.
    settings
        Settings of the monitor.
    history_folder
        Folder of the history of the unit; None or "" to keep the history in memory only.

    Raises
    ------
    ValueError
        If an argument has a wrong type.

    Attributes
    ----------
    unit
        The unit with its history.
    """

    def __init__(
        self,
        description: ActuatorDescription | None = None,
        calibration: AnyCalibration | None = None,
        settings: MonitorSettings | None = None,
        history_folder: str | Path | None = None,
    ) -> None:
        self._description = value_or_default(
            "description", description, ActuatorDescription, ActuatorDescription
        )
        self._calibration = value_or_default(
            "calibration", calibration, CALIBRATIONS, Calibration.builtin
        )
        self._settings = value_or_default("settings", settings, MonitorSettings, MonitorSettings)
        self._intake = Intake(
            self._description.actuator_id,
            self._settings.trigger,
            self._description,
            max_age_s=lambda: self._settings.measured_max_age_s,
        )
        self._diagnosis = Diagnosis()
        key = self._description.unit_key
        require_type("history_folder", history_folder, (str, Path, NoneType))
        path = history_path(Path(history_folder), *key) if history_folder else None
        self.unit = Unit(History(*key, path), self._settings.prognosis)

    def __repr__(self) -> str:
        tests = counted(len(self.unit.history.entries), "valid test")
        return f"<Monitor: {self._description.actuator_id}, {tests}>"

    def feed(self, telemetry: Telemetry) -> Iterator[Output]:
        """Process a block of telemetry; return an iterator of defects, estimates and outlooks.

        Its windows are diagnosed during the iteration.

        Feed blocks in the order of their reception. If the clock of their stamps steps back, the
        level is unknown (``STALE``) until the stamps of tests exceed the stamps before the step. If
        the clock of this computer stepped back as well, or ``has_clock`` is false, tests are
        ordered by the time at which they were fed.

        Raises
        ------
        ValueError
            If ``telemetry`` is not a `Telemetry`.
        """
        require_type("telemetry", telemetry, Telemetry)
        return self._follow(self._intake.feed(telemetry))

    def count(self, count: Count) -> None:
        """Add a count of service hours; it applies to later tests.

        Raises
        ------
        ValueError
            If ``count`` is not a `Count`.
        """
        require_type("count", count, Count)
        self._intake.count(self.unit.history.unit, count)

    def measure(self, stamp_ns: int, measured: Mapping[str, tuple[float, float]]) -> None:
        """Add measured hidden causes; they apply to the windows that begin later.

        They apply until they are older than ``measured_max_age_s``.

        Parameters
        ----------
        stamp_ns
            Time of the measurement [ns].
        measured
            Value and standard deviation by name of the cause (see `measured_causes`).

        Raises
        ------
        ValueError
            If an argument has a wrong type, or a cause is unknown or impossible.
        """
        require_type("stamp_ns", stamp_ns, (int, np.integer))
        self._intake.measure(stamp_ns, measured)

    def finish(self) -> Iterator[Output]:
        """End the telemetry; yield the last defects, estimates and outlooks."""
        yield from self._follow(self._intake.finish())
        yield from self._assess(self._diagnosis.finish())

    def _follow(self, events: Iterable[Segment | Defect]) -> Iterator[Output]:
        settings = self._settings
        for event in events:
            if isinstance(event, Defect):
                yield event
                continue
            yield from self._assess(
                self._diagnosis.add(
                    event,
                    self._calibration,
                    settings.search,
                    settings.combining if event.is_stretch else None,
                )
            )

    def _reception_of(self, estimate: Estimate) -> int:
        """Return the reception time [ns] of a test that must be ordered by reception; else 0.

        Telemetry is fed in the order of its reception. A stamp that is not later than the newest
        stamp therefore comes from a clock that stepped back, or from another recording.
        """
        newest = self.unit.history.newest
        is_later = newest is None or estimate.end_ns > newest.stamp_ns
        return 0 if is_later and self._settings.prognosis.has_clock else time.time_ns()

    def _assess(self, steps: Iterable[Generation | Diagnosed]) -> Iterator[Output]:
        for step in steps:
            if not isinstance(step, Diagnosed):
                continue
            yield step
            use = self._intake.take_use(self.unit.history.unit, step.estimate.end_ns)
            outlook = self.unit.update(
                step.estimate,
                self._calibration.unit_parameters,
                self._settings.prognosis,
                *use,
                received_ns=self._reception_of(step.estimate),
            )
            if outlook is not None:
                yield outlook
