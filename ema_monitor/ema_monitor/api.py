# SPDX-License-Identifier: Apache-2.0
"""Public Python API: faults, health and remaining life from telemetry."""

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ema_core.description import ActuatorDescription
from ema_core.expecting import require_type, value_or_default
from ema_core.faults import FAULTS, FaultVector
from ema_core.telemetry import Telemetry
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.joint_calibration import JointCalibration
from ema_monitor.calibrations import calibrate, load_calibration
from ema_monitor.design.certificate import Certificate, certify
from ema_monitor.design.designing import Design, design_command
from ema_monitor.design.limits import MotionLimits
from ema_monitor.diagnosis import Diagnosed, Diagnosis, Identification, identify
from ema_monitor.health import Health, HealthLimits, assess
from ema_monitor.identification.combination import Combination
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings
from ema_monitor.model.measured import measured_causes
from ema_monitor.monitor import Monitor, MonitorSettings
from ema_monitor.prognosis.duty.course import FutureDuty
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.prediction import Prognosis, RemainingLife
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.growth.tracker_settings import GrowthLaw, KnownLaw, TrackerSettings
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Count
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import ANY_MOTION, Refusal, TriggerSettings
from ema_monitor.windows.window import Window

__all__ = [
    "FAULTS",
    "ActuatorDescription",
    "Calibration",
    "Certificate",
    "Combination",
    "CombinationSettings",
    "Count",
    "Design",
    "Diagnosed",
    "Diagnosis",
    "Estimate",
    "FaultVector",
    "FutureDuty",
    "GrowthLaw",
    "Health",
    "HealthLimits",
    "History",
    "Identification",
    "JointCalibration",
    "KnownLaw",
    "Measurement",
    "Monitor",
    "MonitorSettings",
    "MotionLimits",
    "Outlook",
    "Prognosis",
    "PrognosisSettings",
    "RemainingLife",
    "SearchSettings",
    "Segment",
    "Telemetry",
    "Tracker",
    "TrackerSettings",
    "TriggerSettings",
    "Unit",
    "Window",
    "WindowFinder",
    "assess",
    "calibrate",
    "certify",
    "design_command",
    "find_windows",
    "identify",
    "identify_motion",
    "load_calibration",
    "track",
]


def find_windows(
    telemetry: Telemetry | Iterable[Telemetry],
    description: ActuatorDescription | None = None,
    settings: TriggerSettings | None = None,
) -> list[Window]:
    """Return the usable windows in telemetry.

    For each refused window and each defect of the telemetry, a warning gives the reason.

    Parameters
    ----------
    telemetry
        Telemetry of one actuator, as one block or as blocks in order.
    description
        The actuator; None for the built-in actuator.
    settings
        Trigger settings: start condition and length of a window.

    Raises
    ------
    ValueError
        If ``telemetry`` or an item of it is not a `Telemetry`, or another argument has a wrong
        type.
    """
    finder = WindowFinder(
        value_or_default("settings", settings, TriggerSettings, TriggerSettings),
        value_or_default("description", description, ActuatorDescription, ActuatorDescription),
    )
    windows: list[Window] = []
    for events in (*map(finder.feed, _blocks(telemetry)), finder.finish()):
        for event in events:
            item = event.window if isinstance(event, Segment) else event
            if isinstance(item, Window):
                windows.append(item)
            else:
                stamp_ns = item.start_ns if isinstance(item, Refusal) else item.stamp_ns
                warnings.warn(f"telemetry at {stamp_ns} ns: {item.reason}", stacklevel=2)
    return windows


def _blocks(telemetry: Telemetry | Iterable[Telemetry]) -> list[Telemetry]:
    """Return telemetry as a list of blocks; raise ValueError for other types."""
    hint = "use Telemetry(stamp_ns, sample_period, ...), or ema_bags.read_telemetry for a bag"
    if not isinstance(telemetry, Iterable) or isinstance(telemetry, np.ndarray | str | Path):
        require_type("telemetry", telemetry, Telemetry, hint)
    blocks = [telemetry] if isinstance(telemetry, Telemetry) else list(telemetry)
    for block in blocks:
        require_type("block of telemetry", block, Telemetry, hint)
    return blocks


def identify_motion(
    telemetry: Telemetry | Iterable[Telemetry],
    description: ActuatorDescription | None = None,
    calibration: Calibration | None = None,
    settings: CombinationSettings | None = None,
    *,
    measured: Mapping[str, tuple[float, float]] | None = None,
) -> list[Estimate]:
    """Return estimates of the faults from ordinary motion, without a test cycle.

    Stretches of the motion are combined until the faults reach the wanted accuracy: the result is a
    few estimates, each from many stretches. The list is empty if the motion does not determine any
    fault well enough; `find_windows` and a `Combination` give details.

    Parameters
    ----------
    telemetry
        Telemetry of one actuator, as one block or as blocks in order.
    description, calibration
        The actuator and its calibration; None for the built-in actuator.
    settings
        Settings of the combination of stretches.
    measured
        Measured hidden causes of the whole telemetry: value and standard deviation by name (see
        `identify`).

    Raises
    ------
    ValueError
        If an argument has a wrong type, or a measured cause is unknown or impossible.
    """
    description = value_or_default(
        "description", description, ActuatorDescription, ActuatorDescription
    )
    calibration = value_or_default("calibration", calibration, Calibration, Calibration.builtin)
    settings = value_or_default("settings", settings, CombinationSettings, CombinationSettings)
    causes = measured_causes(value_or_default("measured", measured, Mapping, dict))
    combination = Combination(description, calibration, settings=settings)
    windows = find_windows(telemetry, description, TriggerSettings(windows=ANY_MOTION))
    stretches = [replace(window, measured=causes) for window in windows]
    steps = [step for stretch in stretches for step in combination.add(stretch)]
    return [step for step in steps if isinstance(step, Estimate)] + combination.finish()


def track(
    estimates: Iterable[Estimate],
    hours: Iterable[float],
    limits: HealthLimits | None = None,
    settings: TrackerSettings | None = None,
) -> Tracker:
    """Return a tracker of the growth of faults, updated by the estimates of one unit.

    Its ``predict`` returns the remaining useful life. Invalid estimates are ignored.

    Parameters
    ----------
    estimates
        Estimates of successive tests.
    hours
        Service hours of each test [h], ascending.
    limits
        Fault limits at which life ends.
    settings
        Settings of the growth model; by default no growth law is known.

    Raises
    ------
    ValueError
        If the numbers of hours and estimates differ, the hours descend, or an argument or an item
        of ``estimates`` has a wrong type.
    """
    require_type("estimates", estimates, Iterable, "a list of estimates of identify(window)")
    require_type("hours", hours, Iterable, "a list of service hours [h]")
    tracker, estimates, hours = Tracker(limits, settings), list(estimates), list(hours)
    if len(estimates) != len(hours):
        raise ValueError(
            f"{len(estimates)} estimates and {len(hours)} hours: expected hours for each estimate"
        )
    for estimate, hour in zip(estimates, hours, strict=True):
        require_type("estimate", estimate, Estimate, "identify(window) returns one")
        if estimate.valid:
            tracker.update(Measurement.of(estimate, hour))
    return tracker
