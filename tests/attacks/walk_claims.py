# SPDX-License-Identifier: Apache-2.0
"""OK is reported only with evidence, by a monitor of three units and all sinks of their health."""

import math
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final, NamedTuple, cast

import pyarrow as pa
from hypothesis import strategies as st
from hypothesis.stateful import invariant, precondition, rule

from ema_archive.settings import ArchiveSettings
from ema_archive.tables import BAG_TABLES, UNIT_TABLES, estimate_row
from ema_archive.unit_task import UnitEntry, UnitTask, follow_unit
from ema_cli.bags.unit_course import Course, Step, UnitRecord
from ema_cli.report.verdict import verdict_of
from ema_cli.show.health_table import LatestHealths
from ema_core.description import ActuatorDescription
from ema_core.faults import BACKLASH
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_dashboard.hub import Totals
from ema_dashboard.metrics import Metrics
from ema_interfaces.msg import Health
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.diagnosis import Diagnosed
from ema_monitor.identification.estimate import Estimate
from ema_monitor.node.moment import Moment
from ema_monitor.node.publish.actuator_status import ActuatorStatus
from ema_monitor.node.publish.messages import summary_of
from ema_monitor.node.publish.unit_status import unit_tasks
from ema_monitor.node.receive.arrivals import Arrivals
from ema_monitor.node.receive.receiver_clock import ReceiverClock
from ema_monitor.prognosis.growth.tracker_settings import NOMINAL_LAWS, TrackerSettings
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import StampedTest, unordered
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit
from ema_monitor.windows.finder import WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_ros.claims import Claims

from ..prognosis.made_tests import FIRST_NS, hiding, made_test
from .stateful import Walk

_S = 10**9
_LIMIT_S = 30.0
_AUTHOR = "/ema/monitor"
# A tracker with known laws is created quickly; levels do not depend on its samples.
_TRACKER = TrackerSettings(laws=NOMINAL_LAWS, samples=100)
_PLAIN = PrognosisSettings(tracker=_TRACKER, good_for_s=_LIMIT_S)
_SETTINGS = {
    "flap": replace(_PLAIN, service=Service(hours_per_cycle=10.0)),
    "rudder": _PLAIN,
    # This drive has no clock.
    "tab": replace(_PLAIN, has_clock=False),
}
_ARCHIVED = ArchiveSettings(
    prognosis=PrognosisSettings(tracker=replace(_TRACKER, laws=dict(NOMINAL_LAWS)))
)
_UNITS: Final[tuple[str, ...]] = tuple(_SETTINGS)
_KINDS = {
    "good": {"friction": 0.02},
    "blind": {"friction": 0.02},
    "faulty": {"friction": 0.8},
    "refused": {"valid": False},
    "failed": {"valid": False, "failed": True},
}

# Components that the motion of a test hides, so that they may have a fault.
_HIDDEN = {"blind": ("backlash",)}

_COURSES = [
    *([kind] for kind in _KINDS),
    ["good"] * 3,
    ["good", "good", "faulty"],
    ["good", *["blind"] * 4],
]
_POWER_ON_NS = 100 * _S


class Tested(NamedTuple):
    """The true newest test of a unit: its time [s] and kind."""

    measured_s: float
    kind: str


class Claimed(Walk):
    """A monitor of three units with histories, and a dashboard and a terminal that show them.

    ``clock_s`` is the true time, which never goes back. ``now_ns`` is the time of the machine's
    clock, which nodes and drives use for stamps. A drive may count from its power-on instead.
    """

    def __init__(self) -> None:
        super().__init__()
        memory = "/dev/shm" if Path("/dev/shm").is_dir() else None
        self._folder = tempfile.TemporaryDirectory(prefix="walk_", dir=memory)
        self.now_ns, self.clock_s = FIRST_NS, 1000.0
        # Time of the power-on of drives that count from it [s].
        self.power_on_s: dict[str, float] = {"tab": 900.0}
        # Time and size of each step of the machine's clock [s].
        self.steps: list[tuple[float, float]] = []
        self.newest: dict[str, Tested] = {}
        self.lost: dict[str, Tested] = {}
        # True time of the last test of each unit that hides no component [s].
        self.seen_s: dict[str, float] = dict.fromkeys(_UNITS, -math.inf)
        self.reported: dict[str, list[Estimate]] = {name: [] for name in _UNITS}
        self.latched: dict[str, Health] = {}
        # Boot of the machine, and true time since which the clock is followed [s].
        self.boot = "boot 0"
        self.followed_s = self.clock_s
        self.calibration = 0
        self.is_running = self.is_active = False
        # Unit tested last, and whether its recording is unread since then.
        self.tested, self.unread = _UNITS[0], False
        self._start_sinks()
        self._start()

    def _start_sinks(self) -> None:
        """Start a dashboard and a terminal, which receive the latched messages."""
        self.claims, self.healths = Claims(), LatestHealths()
        self.metrics, self.page = Metrics(Totals), dict[str, int]()
        for health in self.latched.values():
            self._show(health)

    def _show(self, health: Health) -> None:
        for topic, message in (("health", health), ("health_summary", summary_of(health))):
            key = f"/ema/{topic}", health.actuator_id
            self.claims.note(key, message, self.now_ns, self.clock_s)
            self.page[f"{topic} {health.actuator_id}"] = message.level
        self.metrics.note("/ema", health)
        self.healths.add_health("/ema", health, self.clock_s, self.now_ns)

    def _publish(self, health: Health) -> None:
        self.latched[health.actuator_id] = health
        self._show(health)

    def _moment(self) -> Moment:
        """Read the clock as the monitor does, which ends claims if the clock went back."""
        moment, back_ns = self.receiver_clock.read()
        if back_ns:
            for actuator in self.actuators.values():
                actuator.health.end_claim("the clock went back")
            for unit in self.units.values():
                unit.mark_clock_step()
        return moment

    def _start(self) -> None:
        """Start a monitor, which reads the existing histories."""
        self.is_running = self.is_active = True
        self.units, self.actuators = {}, {}
        self.arrivals = dict[str, Arrivals]()
        folder = Path(self._folder.name)
        boot = self.boot
        self.receiver_clock = ReceiverClock(
            lambda: self.now_ns,
            steady_ns=lambda: round(self.clock_s * _S),
            kept=folder / "clock.json",
            boot_id=lambda: boot,
        )
        self._moment()
        for name in _UNITS:
            path = folder / f"{name}.sqlite"
            unit = Unit(History(name, "1", path), _SETTINGS[name], author=_AUTHOR)
            if self.receiver_clock.passed_ns:
                unit.mark_clock_step(self.receiver_clock.passed_ns)
            moment = self._moment()
            finder, arrivals = WindowFinder(TriggerSettings()), Arrivals()
            actuator = ActuatorStatus(name, finder, self._publish, moment.steady_ns, arrivals)
            # The drive sends telemetry during motion and rest.
            for before in range(20, 0, -1):
                end_ns = self._stamp_ns(name, 0.1 * before)
                steady_ns = round((self.clock_s - 0.1 * before) * _S)
                arrivals.add(end_ns - _S // 10, end_ns, steady_ns)
            description = ActuatorDescription(actuator_id=name, serial_number="1")
            finder.describe(description)
            self.units[name], self.actuators[name] = unit, actuator
            self.arrivals[name] = arrivals
            if (outlook := unit.resume(None, _SETTINGS[name])) is not None:
                actuator.health.resume(description, outlook, moment)
        self._report()

    def _report(self) -> None:
        """Do the periodic work of monitor, dashboard and terminal."""
        if self.is_running:
            moment = self._moment()
            for actuator in self.actuators.values():
                if self.is_active:
                    actuator.expire(_LIMIT_S, moment)
        for (topic, name), held in self.claims.changes(self.now_ns, self.clock_s, self._is_silent):
            self.page[f"{topic.removeprefix('/ema/')} {name}"] = held.level
            if topic == "/ema/health":
                self.metrics.note("/ema", held)

    def _is_silent(self, _: str, author: str) -> bool:
        """Return whether the lease of the monitor is over; it ends soon after the monitor."""
        return author == _AUTHOR and not self.is_running

    def _pass(self, seconds: float) -> None:
        self.now_ns += round(seconds * _S)
        self.clock_s += seconds
        self._report()

    def _stamp_ns(self, name: str, ago_s: float = 0.0) -> int:
        """Return the stamp of a unit's drive for the time ``ago_s`` before now [ns]."""
        ago_ns = round(ago_s * _S)
        if name in self.power_on_s:
            up_s = self.clock_s - self.power_on_s[name]
            return max(_POWER_ON_NS + round(up_s * _S) - ago_ns, 0)
        later = (step_s for at_s, step_s in self.steps if at_s > self.clock_s - ago_s)
        return self.now_ns - ago_ns - round(sum(later) * _S)

    def _arrive(self, name: str, end_ns: int, pace: float) -> bool:
        """Receive the telemetry of a test. Return whether its arrival shows that it is new."""
        arrivals, now_ns, block_ns = self.arrivals[name], self.clock_s * _S, _S // 10
        for before in range(5, 0, -1):
            block_end_ns = end_ns - (before - 1) * block_ns
            received_ns = round(now_ns - pace * (before - 1) * block_ns)
            arrivals.add(block_end_ns - block_ns, block_end_ns, received_ns)
        return arrivals.are_live(end_ns)

    def _test(self, name: str, kind: str, ago_s: float = 0.0, pace: float = 1.0) -> None:
        """Test a unit, or receive a test that ended ``ago_s`` before now.

        ``pace`` 1 receives the telemetry in real time, 0 all at once.
        """
        made = made_test(len(self.reported[name]), **_KINDS[kind])
        if kind in _HIDDEN:
            made = hiding(made, _HIDDEN[kind])
        end_ns = self._stamp_ns(name, ago_s)
        estimate = replace(
            made,
            start_ns=end_ns - _S // 2,
            end_ns=end_ns,
            calibration_id=f"calibration {self.calibration}",
        )
        unit, actuator = self.units[name], self.actuators[name]
        # The node reads its clock before each test.
        self._moment()
        is_live = self._arrive(name, end_ns, pace)
        outlook = unit.update(
            estimate, None, _SETTINGS[name], received_ns=self.now_ns, is_live=is_live
        )
        number, description = len(self.reported[name]), actuator.finder.description
        actuator.record(Diagnosed(number, number, description, estimate), outlook, self._moment())
        self.reported[name].append(estimate)
        self.tested, self.unread = name, True
        measured_s = self.clock_s - ago_s
        if made.valid and kind not in _HIDDEN:
            self.seen_s[name] = max(self.seen_s[name], measured_s)
        if measured_s > self.newest.get(name, Tested(-math.inf, "")).measured_s:
            self.newest[name] = Tested(measured_s, kind)

    @precondition(lambda self: self.is_running and self.is_active)
    @rule(
        name=st.sampled_from(_UNITS),
        kinds=st.sampled_from(_COURSES),
        pace=st.sampled_from((1.0, 1.0, 0.7, 0.0)),
    )
    def test(self, name: str, kinds: Sequence[str], pace: float = 1.0) -> None:
        """Test a unit several times; the last test ends now."""
        for kind in kinds:
            self._pass(10.0)
            self._test(name, kind, pace=pace)

    @precondition(lambda self: self.is_running and self.is_active)
    @rule(name=st.sampled_from(_UNITS), faulty=st.booleans())
    def test_well(self, name: str, *, faulty: bool) -> None:
        """Test a unit three times healthy, so that it may be OK, and optionally once faulty."""
        self.test(name, ["good"] * 3 + ["faulty"] * faulty)

    @precondition(lambda self: self.is_running and self.is_active)
    @rule(
        kind=st.sampled_from(["good", "good", *_KINDS]),
        late_s=st.sampled_from((3.0, 25.0, 595.0, 1800.0, 3605.0)),
        pace=st.sampled_from((0.0, 0.3)),
    )
    def test_late(self, kind: str, late_s: float, pace: float) -> None:
        """Receive a stored test that ended ``late_s`` before the last test of its unit.

        It is sent faster than it was measured. A monitor without earlier files does not know
        earlier steps of the clock, so that such a test may look new.
        """
        name = self.tested
        self._pass(1.0)
        newest_s = self.newest[name].measured_s if name in self.newest else self.clock_s
        ago_s = self.clock_s - newest_s + late_s
        is_of_before = self.clock_s - ago_s < self.followed_s
        if not is_of_before:
            self._test(name, kind, ago_s, pace)

    @rule(seconds=st.sampled_from((1.0, 6.0, 40.0)))
    def wait(self, seconds: float) -> None:
        """Receive nothing for a while."""
        self._pass(seconds)

    @rule(seconds=st.sampled_from((-3600.0, -600.0, -20.0, -2.0, 5.0, 3600.0)))
    def step_clock(self, seconds: float) -> None:
        """Set the clock of the machine."""
        self.now_ns += round(seconds * _S)
        self.steps.append((self.clock_s, seconds))
        self._report()

    @rule(name=st.sampled_from(_UNITS), passed_s=st.sampled_from((0.0, 0.5, 10.0)))
    def power_on(self, name: str, passed_s: float) -> None:
        """Let a drive count its stamps from a power-on ``passed_s`` ago."""
        self.power_on_s[name] = self.clock_s - passed_s

    @precondition(lambda self: "flap" in self.power_on_s)
    @rule()
    def set_drive_clock(self) -> None:
        """Give the drive a clock, as the other drives have."""
        del self.power_on_s["flap"]

    @rule()
    def recalibrate(self) -> None:
        """Use another calibration for the tests from now on."""
        self.calibration += 1

    @precondition(lambda self: self.is_running)
    @rule()
    def kill(self) -> None:
        """Kill the monitor. Its latched messages are gone, but receivers still have them."""
        self.is_running = self.is_active = False
        self.latched.clear()
        for unit in self.units.values():
            unit.history.close()
        self._pass(6.0)

    @precondition(lambda self: self.is_running and self.is_active)
    @rule()
    def deactivate(self) -> None:
        """Deactivate the monitor."""
        self.is_active = False
        for actuator in self.actuators.values():
            actuator.health.withdraw("the monitor is not active")
        self._pass(1.0)

    @precondition(lambda self: not self.is_active)
    @rule(disk=st.booleans(), reboot=st.booleans())
    def start_again(self, *, disk: bool, reboot: bool) -> None:
        """Restart the monitor or its machine, with or without its histories."""
        for unit in self.units.values():
            unit.history.close()
        if not disk:
            self.lost |= self.newest
            self.newest = {}
            for file in Path(self._folder.name).iterdir():
                file.unlink()
        if reboot:
            self.boot = f"boot {self.clock_s}"
        if reboot or not disk:
            self.followed_s = self.clock_s
        self._start()

    @rule()
    def start_sinks(self) -> None:
        """Start another dashboard and terminal."""
        self._start_sinks()
        self._report()

    @precondition(lambda self: self.unread)
    @rule()
    def read(self) -> None:
        """Read a recording of all tests of the unit tested last, by commands and an archive."""
        self.unread = False
        self._read_archive(self.tested)
        self._read_command(self.tested)

    def _read_command(self, name: str) -> None:
        """Check that a command reports the level of the newest test."""
        tests = self.reported[name]
        stamped = (StampedTest(test.start_ns, test.end_ns, "bag", "bag") for test in tests)
        if unordered(stamped):
            return  # it is refused
        ordered = sorted(tests, key=lambda test: test.end_ns)
        settings = replace(_SETTINGS[name], good_for_s=0.0)
        follow = Unit(History(name, "1"), settings).follow(ordered, None, settings)
        levels = [outlook.health.level for _, outlook in follow if outlook]
        if tests and not _is_good(tests[-1]):
            assert levels[-1] != OK, "a command reports OK"
        latest = [test for test in ordered if test.valid][-3:]
        if latest and all(test.unobservable[BACKLASH] for test in latest):
            assert levels[-1] != OK, "a command reports OK of tests that hide a fault"
        self._read_report(name, ordered, levels)

    def _read_report(self, name: str, tests: Sequence[Estimate], levels: Sequence[int]) -> None:
        """Check that the report of these tests has the same level as the command."""
        description = self.actuators[name].finder.description
        record = UnitRecord(description, [], [], [], [])
        settings = replace(_SETTINGS[name], good_for_s=0.0)
        unit = Unit(History(name, "1"), settings)
        steps = [Step(*step) for step in unit.follow(tests, None, settings)]
        predicting = SimpleNamespace(costs=None)
        course = Course(record, cast(Any, predicting), Calibration.builtin(), steps, unit.growth)
        verdict = verdict_of(course)
        expected = levels[-1] if levels else STALE
        assert verdict.level == expected, "the report has another level than the command"
        assert verdict.lines[0].startswith("Well") == (expected == OK), "Well in the report"

    def _read_archive(self, name: str) -> None:
        tests = self.reported[name]
        made = {"bag": "bag", "bag_sha256": "", "software": "", "settings": ""}
        rows = [estimate_row(test, number) | made for number, test in enumerate(tests)]
        result = follow_unit(
            UnitTask(
                UnitEntry(name, name, "1", "", ""),
                _ARCHIVED,
                pa.Table.from_pylist(rows, BAG_TABLES["estimates"]),
                BAG_TABLES["usage"].empty_table(),
                BAG_TABLES["duty"].empty_table(),
                UNIT_TABLES["health"].empty_table(),
                None,
            )
        )
        [level] = result.tables["units"]["level"].to_pylist()
        stamped = (StampedTest(test.start_ns, test.end_ns, "bag", "bag") for test in tests)
        if not tests or unordered(stamped) or not _is_good(tests[-1]):
            assert level != OK, "an archive reports OK"

    @precondition(lambda self: self.is_running and self.is_active)
    @rule(name=st.sampled_from(_UNITS))
    def predict(self, name: str) -> None:
        """Request a prediction from the monitor."""
        unit = self.units[name]
        if unit.history.entries:
            outlook = self.actuators[name].health.worth(
                unit.outlook(None, _SETTINGS[name]), self._moment()
            )
            assert self._knows(name) or outlook.health.level != OK, "a prediction reports OK"

    def _knows(self, name: str) -> bool:
        """Return whether there is evidence that a unit is OK."""
        measured_s, kind = self.newest.get(name, self.lost.get(name, Tested(-math.inf, "")))
        since_s = min(measured_s, self.seen_s[name])
        is_good = kind in ("good", "blind")
        return self.is_active and is_good and self.clock_s - since_s <= _LIMIT_S

    @invariant()
    def ok_needs_evidence(self) -> None:
        """Check the levels of each unit in all sinks, which must agree."""
        levels = self._levels()
        for name in _UNITS:
            if not self._knows(name):
                printed = [
                    sink for (unit, sink), level in levels.items() if (unit, level) == (name, OK)
                ]
                assert printed == [], f"{name} is reported as OK by {', '.join(printed)}"
        for name, health in self.latched.items():
            # A unit with a warning has no index of 1.
            assert health.level not in (WARN, ERROR) or not health.health_index > 0.99
            printed = {sink: level for (unit, sink), level in levels.items() if unit == name}
            # A sink may let a claim expire shortly before the monitor does.
            assert set(printed.values()) <= {health.level, STALE}, f"{name}: {printed}"
            assert printed.get("status", health.level) == health.level, f"{name}: {printed}"

    def _levels(self) -> dict[tuple[str, str], int]:
        """Return the levels by unit and sink."""
        levels: dict[tuple[str, str], int] = {}
        for family in self.metrics.collect():
            for sample in family.samples if family.name == "ema_health_level" else ():
                levels[sample.labels["actuator_id"], "metrics"] = int(sample.value)
        for shown, level in self.page.items():
            topic, _, name = shown.partition(" ")
            levels[name, f"page, {topic}"] = level
        for row in self.healths.rows(self.clock_s, self.now_ns, self._is_silent):
            levels[row.actuator_id, "terminal"] = row.level
        for name, health in self.latched.items():
            levels[name, "topic"] = health.level
            if self.is_active:
                levels[name, "status"] = unit_tasks(self.actuators[name], 0)[1].level
        return levels

    def teardown(self) -> None:
        """Remove the files."""
        super().teardown()
        for unit in self.units.values():
            unit.history.close()
        self._folder.cleanup()


def _is_good(estimate: Estimate) -> bool:
    return estimate.valid and estimate.faults.friction < 0.5
