# SPDX-License-Identifier: Apache-2.0
"""Settings of the monitor node, and settings of the library as ROS parameters."""

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from rclpy.node import Node

from ema_core.quantity import Checked, flag, quantity, text
from ema_monitor.baselines.unit_baseline import MOST_RECORDS
from ema_monitor.health import HealthLimits
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings
from ema_monitor.model.measurements import MAX_AGE_S
from ema_monitor.prognosis.advice import Costs
from ema_monitor.prognosis.duty.damage import DamageSettings
from ema_monitor.prognosis.fleet_growth import FleetGrowth
from ema_monitor.prognosis.growth.tracker_settings import KnownLawTexts, TrackerSettings
from ema_monitor.prognosis.requirements.requirements import RequirementLimits
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.windows.trigger import TriggerSettings
from ema_ros.node_parameters import LiveSettings

IN_MEMORY: Final = "memory"
"""Value of ``history_folder`` that keeps histories in memory only."""

_PERIODS: Final = 3.0


@dataclass(frozen=True)
class Files(Checked):
    """Files that the monitor reads and writes."""

    calibration_file: str = text(
        "",
        "calibration file; {actuator_id} and {serial_number} in the path are replaced for each "
        "actuator; empty: the shipped calibration of the built-in actuator",
    )
    calibration_folder: str = text(
        "$ROS_HOME/ema", "folder of the calibration files that ~/calibrate writes, or loads by name"
    )
    actuator_file: str = text(
        "", "actuator file for actuators that do not publish a description; empty: none"
    )
    history_folder: str = text(
        "$ROS_HOME/ema/history",
        f"folder of the unit histories; {IN_MEMORY!r}, or simulated time: kept in memory only",
    )
    baseline_folder: str = text(
        "",
        "folder in which the baselines of units with an unknown drive are learned, instead of "
        "calibration_file; empty: none is learned",
    )
    fleet_file: str = text(
        "", "growth of the faults of other units: file written by `ema learn-fleet`; empty: none"
    )

    @property
    def baselines(self) -> Path | None:
        """Folder of the learned baselines; None if no baselines are learned."""
        return folder_of(self.baseline_folder) if self.baseline_folder else None

    def histories(self, *, is_simulated: bool) -> Path | None:
        """Return the folder of the histories; None to keep histories in memory only.

        In simulated time it is None: a replayed bag must not mix with tests of the actuator.
        """
        is_on_disk = self.history_folder not in ("", IN_MEMORY) and not is_simulated
        return folder_of(self.history_folder) if is_on_disk else None


@dataclass(frozen=True)
class Operation(Checked):
    """Limits, timeouts, baseline acceptance and clock of a running monitor."""

    most_actuators: int = quantity(
        100, "-", 1, 10_000, "largest number of actuators to monitor; further ones are refused"
    )
    waiting_windows: int = quantity(
        2,
        "-",
        1,
        10_000,
        "queue length per actuator; if full, the oldest window is dropped (not in simulated time)",
    )
    expected_period_s: float = quantity(
        10.0, "s", 0.1, 1e7, "expected time between estimates; health is stale after three"
    )
    calibration_timeout_s: float = quantity(
        60.0, "s", 1.0, 1e5, "timeout of a calibration for its next window"
    )
    level_confirmations: int = quantity(2, "-", 1, 100, "consecutive tests that lower a level")
    measured_max_age_s: float = quantity(
        MAX_AGE_S,
        "s",
        0.0,
        1e7,
        "largest age of a measured cause at the start of a window that uses it",
    )
    history_max_offset_s: float = quantity(
        3600.0,
        "s",
        1.0,
        1e10,
        "largest difference between stamp and node clock; other tests are not recorded",
    )

    accept_after: int = quantity(
        0,
        "-",
        0,
        MOST_RECORDS,
        "records with which a learned baseline is accepted; 0: a person accepts it",
    )
    accept_days: int = quantity(
        1, "-", 1, 30, "smallest number of days of these records for automatic acceptance"
    )

    has_clock: bool = flag(
        True,
        "whether stamps come from a clock; if false (stamps restart with the drive), tests are "
        "ordered by reception",
    )

    @property
    def good_for_s(self) -> float:
        """Time for which a level stays valid after its test [s]."""
        return self.good_for(0.0)

    def good_for(self, longest_s: float) -> float:
        """Return how long a level stays valid after a test of up to ``longest_s`` [s]."""
        return _PERIODS * max(self.expected_period_s, longest_s)


class NodeSettings:
    """Current settings of a monitor; all can be changed at run time.

    Parameters
    ----------
    node
        Node on which the settings are declared as parameters.
    restart
        Called with the new trigger settings whenever these change.
    """

    def __init__(self, node: Node, restart: Callable[[TriggerSettings], None]) -> None:
        self.search = LiveSettings(node, SearchSettings)
        self.combining = LiveSettings(node, CombinationSettings)
        self.costs = LiveSettings(node, Costs, "costs.")
        self.operation = LiveSettings(node, Operation)
        self.trigger = LiveSettings(node, TriggerSettings, on_change=restart)
        self.limits = LiveSettings(node, HealthLimits, "limits.")
        self.requirements = LiveSettings(node, RequirementLimits, "requirements.")
        self.tracker = LiveSettings(node, TrackerSettings, "tracker.")
        self.laws = LiveSettings(node, KnownLawTexts, "known_law.")
        self.service = LiveSettings(node, Service)
        self.damage = LiveSettings(node, DamageSettings, "damage.")

    def prognosis(self, fleet: FleetGrowth | None) -> PrognosisSettings:
        """Return the prognosis settings, including the growth of a fleet."""
        operation = self.operation.value
        return PrognosisSettings(
            self.limits.value,
            self.requirements.value,
            replace(self.tracker.value, laws=self.laws.value.laws()),
            self.service.value,
            fleet,
            self.damage.value,
            good_for_s=operation.good_for_s,
            level_confirmations=operation.level_confirmations,
            has_clock=operation.has_clock,
        )


def folder_of(text: str) -> Path:
    """Return the path in a parameter, with environment variables and ``~`` expanded.

    ``$ROS_HOME`` is ``~/.ros`` unless it is set.
    """
    ros_home = os.environ.get("ROS_HOME") or "~/.ros"
    return Path(os.path.expandvars(text.replace("$ROS_HOME", ros_home))).expanduser()
