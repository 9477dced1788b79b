"""The monitor as a library: from telemetry to faults, health and remaining life."""

import warnings
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ema_core.description import ActuatorDescription
from ema_core.expecting import require_type
from ema_core.faults import FAULTS, FaultVector
from ema_core.telemetry import Telemetry
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibrations import calibrate, load_calibration
from ema_monitor.design.certificate import Certificate, certify
from ema_monitor.design.designing import Design, design_command
from ema_monitor.design.limits import MotionLimits
from ema_monitor.diagnosis import Diagnosed, Diagnosis, Identification, identify
from ema_monitor.health import Health, HealthLimits, assess
from ema_monitor.identification.combination import Combination
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings
from ema_monitor.monitor import Monitor, MonitorSettings
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.prediction import Prognosis, RemainingLife
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.growth.tracker_settings import GrowthLaw, KnownLaw, TrackerSettings
from ema_monitor.prognosis.history_entry import Count
from ema_monitor.prognosis.outlook import Outlook
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
    "GrowthLaw",
    "Health",
    "HealthLimits",
    "Identification",
    "KnownLaw",
    "Monitor",
    "MonitorSettings",
    "MotionLimits",
    "Outlook",
    "Prognosis",
    "RemainingLife",
    "SearchSettings",
    "Segment",
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
    """Return the windows in telemetry that can be used.

    Of a stretch that begins like a window and cannot be used, and of a defect of the telemetry,
    there is a warning with the reason.

    Parameters
    ----------
    telemetry
        Telemetry of one actuator, as one block or as blocks in order.
    description
        The actuator; the built-in one when None.
    settings
        When a window begins and how long it is.

    Raises
    ------
    ValueError
        When it is given anything but telemetry.
    """
    finder = WindowFinder(settings or TriggerSettings(), description or ActuatorDescription())
    windows: list[Window] = []
    for events in (*map(finder.feed, _blocks(telemetry)), finder.finish()):
        for event in events:
            found = event.window if isinstance(event, Segment) else event
            if isinstance(found, Window):
                windows.append(found)
            else:
                place = found.start_ns if isinstance(found, Refusal) else found.stamp_ns
                warnings.warn(f"telemetry at {place} ns: {found.reason}", stacklevel=2)
    return windows


def _blocks(telemetry: Telemetry | Iterable[Telemetry]) -> list[Telemetry]:
    """Return the blocks of telemetry; ValueError for anything else."""
    hint = "Telemetry(stamp_ns, sample_period, ...) takes columns, ema_bags.read_telemetry a bag"
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
) -> list[Estimate]:
    """Identify the faults in ordinary motion; it needs no test cycle.

    Stretches of the motion are combined until the faults are known as well as the settings want,
    so that there are few estimates, each of many stretches. There is none where the motion shows no
    fault well enough; `find_windows` and a `Combination` tell more.

    Parameters
    ----------
    telemetry
        Telemetry of one actuator, as one block or as blocks in order.
    description, calibration
        The actuator and its calibration; those of the built-in one when None.
    settings
        Until when stretches are combined.
    """
    description = description or ActuatorDescription()
    calibration = calibration or Calibration.builtin()
    combination = Combination(description, calibration, settings=settings)
    stretches = find_windows(telemetry, description, TriggerSettings(windows=ANY_MOTION))
    found = [one for stretch in stretches for one in combination.add(stretch)]
    return [one for one in found if isinstance(one, Estimate)] + combination.finish()


def track(
    estimates: Iterable[Estimate],
    hours: Iterable[float],
    limits: HealthLimits | None = None,
    settings: TrackerSettings | None = None,
) -> Tracker:
    """Return a tracker of the growth of faults that knows the estimates of one unit.

    Its ``predict`` gives the remaining useful life. Estimates that are not valid are left out.

    Parameters
    ----------
    estimates
        Estimates of successive tests.
    hours
        Service hours of each of them [h], ascending.
    limits
        Where life ends.
    settings
        What is assumed of growth; by default that no law is known.

    Raises
    ------
    ValueError
        When there are not as many hours as estimates, the hours descend, or an estimate is none.
    """
    tracker, estimates, hours = Tracker(limits, settings), list(estimates), list(hours)
    if len(estimates) != len(hours):
        raise ValueError(
            f"{len(estimates)} estimates and {len(hours)} hours: expected an hour for each estimate"
        )
    for estimate, hour in zip(estimates, hours, strict=True):
        require_type("estimate", estimate, Estimate, "identify(window) gives one")
        if estimate.valid:
            tracker.update(Measurement.of(estimate, hour))
    return tracker
