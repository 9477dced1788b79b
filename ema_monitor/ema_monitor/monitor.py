"""Monitor of one actuator: telemetry in, what happened out. It needs no ROS."""

import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibrations import AnyCalibration
from ema_monitor.diagnosis import Diagnosed, Diagnosis
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.search import Generation
from ema_monitor.identification.settings import SearchSettings
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

Event = Defect | Diagnosed | Outlook
"""A defect of the telemetry; the estimate of a window, or its refusal; health and life after it."""


@dataclass(frozen=True)
class MonitorSettings:
    """How an actuator is monitored.

    Attributes
    ----------
    trigger
        When a window begins and how long it is.
    search
        How its faults are identified.
    combining
        Until when stretches of ordinary motion are combined.
    prognosis
        What health and remaining life rest on.
    measured_max_age_s
        Age at the start of a window up to which a measurement holds for it [s].
    """

    trigger: TriggerSettings = field(default_factory=TriggerSettings)
    search: SearchSettings = field(default_factory=SearchSettings)
    combining: CombinationSettings = field(default_factory=CombinationSettings)
    prognosis: PrognosisSettings = field(default_factory=PrognosisSettings)
    measured_max_age_s: float = MAX_AGE_S


class Monitor:
    """Monitors one actuator: finds its windows, diagnoses them, and follows the unit.

    The node does the same with each part in the thread where it belongs, and has the same `Intake`.

    Parameters
    ----------
    description
        The actuator; the built-in one by default.
    calibration
        Its calibration; the shipped one by default.
    settings
        How to monitor it.
    history_folder
        Folder of the history of the unit; in memory alone when None.

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
        history_folder: Path | None = None,
    ) -> None:
        self._description = description or ActuatorDescription()
        self._calibration = calibration or Calibration.builtin()
        self._settings = settings or MonitorSettings()
        self._intake = Intake(
            self._description.actuator_id,
            self._settings.trigger,
            self._description,
            max_age_s=lambda: self._settings.measured_max_age_s,
        )
        self._diagnosis = Diagnosis()
        key = self._description.unit_key
        path = history_path(history_folder, *key) if history_folder else None
        self.unit = Unit(History(*key, path), self._settings.prognosis)

    def feed(self, telemetry: Telemetry) -> Iterator[Event]:
        """Yield what a block of telemetry leads to, in its order.

        Blocks are fed in the order in which they were received. If the clock of their stamps goes
        back, the level is unknown (``STALE``) until tests are later than before. If the clock of
        this computer went back as well, or ``has_clock`` is false, the order of feeding counts.
        """
        return self._follow(self._intake.feed(telemetry))

    def count(self, count: Count) -> None:
        """Take a count of service hours; it holds for the tests after its stamp."""
        self._intake.count(self.unit.history.unit, count)

    def measure(self, stamp_ns: int, measured: Mapping[str, tuple[float, float]]) -> None:
        """Take hidden causes that were measured; they hold for the windows that begin after.

        Parameters
        ----------
        stamp_ns
            When they were measured [ns].
        measured
            Value and standard deviation by name, as of `measured_causes`.

        Raises
        ------
        ValueError
            As of `measured_causes`.
        """
        self._intake.measure(stamp_ns, measured)

    def finish(self) -> Iterator[Event]:
        """End the telemetry; yield what that leads to."""
        yield from self._follow(self._intake.finish())
        yield from self._assess(self._diagnosis.finish())

    def _follow(self, events: Iterable[Segment | Defect]) -> Iterator[Event]:
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
        """Return the time [ns] if a test has to be ordered by its reception, else 0.

        Telemetry is fed in the order in which it was received: a stamp that is not later than the
        newest test's is of a clock that went back, or of another recording.
        """
        newest = self.unit.history.newest
        is_later = newest is None or estimate.end_ns > newest.stamp_ns
        return 0 if is_later and self._settings.prognosis.has_clock else time.time_ns()

    def _assess(self, found: Iterable[Generation | Diagnosed]) -> Iterator[Event]:
        for one in found:
            if not isinstance(one, Diagnosed):
                continue
            yield one
            use = self._intake.take_use(self.unit.history.unit, one.estimate.end_ns)
            outlook = self.unit.update(
                one.estimate,
                self._calibration.unit_parameters,
                self._settings.prognosis,
                *use,
                received_ns=self._reception_of(one.estimate),
            )
            if outlook is not None:
                yield outlook
