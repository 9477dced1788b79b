"""Nobody says OK who does not know: two units, their monitor, and whoever shows their health."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from hypothesis import strategies as st
from hypothesis.stateful import invariant, precondition, rule

from ema_cli.fleet import HeardFleet
from ema_core.description import ActuatorDescription
from ema_core.levels import OK
from ema_dashboard.hub import Totals
from ema_dashboard.metrics import Metrics
from ema_interfaces.msg import Health
from ema_monitor.diagnosis import Diagnosed
from ema_monitor.identification.estimate import Estimate
from ema_monitor.node.actuator import Actuator
from ema_monitor.node.unit_status import unit_tasks
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit
from ema_monitor.windows.trigger import TriggerSettings
from ema_ros.claims import Claims

from ..prognosis.made_tests import FIRST_NS, PERIOD_NS, made_test
from .stateful import Walk

_S = 10**9
_LIMIT_S = 30.0
_AUTHOR = "/ema/monitor"
_SETTINGS = PrognosisSettings(good_for_s=_LIMIT_S)
_UNITS: Final[tuple[str, ...]] = ("flap", "rudder")
_KINDS = {
    "good": {"friction": 0.02},
    "faulty": {"friction": 0.8},
    "refused": {"valid": False},
    "failed": {"valid": False, "failed": True},
}

_COURSES = [[kind] for kind in _KINDS] + [["good"] * 3, ["good", "good", "faulty"]]


class Claimed(Walk):
    """A monitor of two units, a dashboard and a terminal that have heard it, and its histories.

    Time passes as it is told; tests are stamped by their number, late ones between others.
    """

    def __init__(self) -> None:
        super().__init__()
        self._folder = tempfile.TemporaryDirectory(prefix="walk_")
        self.now_ns, self.clock_s = FIRST_NS, 0.0
        self.number: dict[str, float] = dict.fromkeys(_UNITS, 0.0)
        # What each unit is known by: stamp of the newest test [ns] and its kind.
        self.newest: dict[str, tuple[int, str]] = {}
        self.lost: dict[str, tuple[int, str]] = {}
        self.told: dict[str, list[Estimate]] = {name: [] for name in _UNITS}
        self.latched: dict[str, Health] = {}
        self.is_running = self.is_active = False
        self.tested = _UNITS[0]
        self._come()
        self._start()

    def _come(self) -> None:
        """A dashboard and a terminal that know nothing yet; they get what is latched."""
        self.claims, self.fleet = Claims(), HeardFleet()
        self.metrics = Metrics(["/ema"], Totals)
        for health in self.latched.values():
            self._show(health)

    def _show(self, health: Health) -> None:
        self.claims.note(("/ema/health", health.actuator_id), health)
        self.metrics.note("/ema", health)
        self.fleet.add_health("/ema", health, self.clock_s)

    def _publish(self, health: Health) -> None:
        self.latched[health.actuator_id] = health
        self._show(health)

    def _start(self) -> None:
        """Start a monitor; it reads the histories that are there."""
        self.is_running = self.is_active = True
        self.units, self.actuators = {}, {}
        for name in _UNITS:
            path = Path(self._folder.name) / f"{name}.sqlite"
            unit = Unit(History(name, "1", path), _SETTINGS, author=_AUTHOR)
            actuator = Actuator(name, TriggerSettings(), self._publish, self.now_ns)
            description = ActuatorDescription(actuator_id=name, serial_number="1")
            actuator.finder.describe(description)
            self.units[name], self.actuators[name] = unit, actuator
            if (outlook := unit.resume(None, _SETTINGS)) is not None:
                actuator.resume(description, outlook, self.now_ns)
        self._report()

    def _report(self) -> None:
        """What a monitor and the others do each second."""
        if self.is_running:
            for name, actuator in self.actuators.items():
                if self.is_active:
                    actuator.publish_if_stale(_LIMIT_S, self.now_ns)
                self.claims.hear(f"{_AUTHOR}: {name} health", self.clock_s)
                self.fleet.add_status(f"{_AUTHOR}: {name} health", self.clock_s)
        for _, health in self.claims.changes(self.now_ns, self.clock_s):
            self.metrics.note("/ema", health)

    def _pass(self, seconds: float) -> None:
        self.now_ns += round(seconds * _S)
        self.clock_s += seconds
        self._report()

    def _tell(self, name: str, estimate: Estimate, kind: str) -> None:
        unit, actuator = self.units[name], self.actuators[name]
        outlook = unit.update(estimate, None, _SETTINGS, received_ns=self.now_ns)
        number, description = len(self.told[name]), actuator.finder.description
        actuator.record(Diagnosed(number, number, description, estimate), outlook, self.now_ns, 2)
        self.told[name].append(estimate)
        if estimate.end_ns > self.newest.get(name, (0, ""))[0]:
            self.newest[name] = estimate.end_ns, kind

    @precondition(lambda self: self.is_running and self.is_active)
    @rule(name=st.sampled_from(_UNITS), kinds=st.sampled_from(_COURSES))
    def test(self, name: str, kinds: Sequence[str]) -> None:
        """Tests of which the last ends now."""
        self.tested = name
        for kind in kinds:
            self._pass(10.0)
            self.number[name] = (self.now_ns - FIRST_NS) / PERIOD_NS
            self._tell(name, made_test(self.number[name], **_KINDS[kind]), kind)

    @precondition(lambda self: self.is_running and self.is_active)
    @rule(kind=st.sampled_from(["good", "good", *_KINDS]), late_s=st.sampled_from((3.0, 1800.0)))
    def test_late(self, kind: str, late_s: float) -> None:
        """A test that ended before the last one of a unit, or long ago."""
        name = self.tested
        self._pass(1.0)
        number = self.number[name] - late_s * _S / PERIOD_NS
        self._tell(name, made_test(number, **_KINDS[kind]), kind)

    @rule(seconds=st.sampled_from((1.0, 6.0, 40.0)))
    def wait(self, seconds: float) -> None:
        """Nothing comes for a while."""
        self._pass(seconds)

    @precondition(lambda self: self.is_running)
    @rule()
    def kill(self) -> None:
        """The monitor is gone, and what it had latched; who heard it still has that."""
        self.is_running = self.is_active = False
        self.latched.clear()
        for unit in self.units.values():
            unit.history.close()
        self._pass(6.0)

    @precondition(lambda self: self.is_running and self.is_active)
    @rule()
    def deactivate(self) -> None:
        """The monitor is told to stop."""
        self.is_active = False
        for actuator in self.actuators.values():
            actuator.withdraw_health("the monitor is not active")
        self._pass(1.0)

    @precondition(lambda self: not self.is_active)
    @rule(disk=st.booleans())
    def start_again(self, *, disk: bool) -> None:
        """The monitor is started, or activated, with its histories or without."""
        for unit in self.units.values():
            unit.history.close()
        if not disk:
            self.lost |= self.newest
            self.newest = {}
            for file in Path(self._folder.name).iterdir():
                file.unlink()
        self._start()

    @rule()
    def come(self) -> None:
        """A dashboard and a terminal that were not there before."""
        self._come()
        self._report()

    @rule(name=st.sampled_from(_UNITS))
    def read(self, name: str) -> None:
        """A command reads all tests: what it says is that of the newest."""
        tests = sorted(self.told[name], key=lambda one: one.end_ns)
        follow = Unit(History(name, "1")).follow(tests, None, PrognosisSettings())
        levels = [outlook.health.level for _, outlook in follow if outlook]
        if tests and not (tests[-1].valid and tests[-1].faults.friction < 0.5):
            assert levels[-1] != OK, "a command says OK"

    def _knows(self, name: str) -> bool:
        """Return whether a unit may be said to be OK."""
        stamp_ns, kind = self.newest.get(name, self.lost.get(name, (0, "")))
        if not self.is_active:
            return False
        return kind == "good" and (self.now_ns - stamp_ns) / _S <= _LIMIT_S

    @invariant()
    def nobody_says_ok_who_does_not_know(self) -> None:
        """Each sink is asked of each unit."""
        for name in _UNITS:
            said = self._said_ok(name)
            if not self._knows(name):
                assert said == [], f"{name} is said to be OK by {', '.join(said)}"

    def _said_ok(self, name: str) -> list[str]:
        """Return the names of the sinks by which a unit is OK."""
        said = {"metrics": False, "terminal": False}
        key = ("ema_health_level", name)
        for family in self.metrics.collect():
            for sample in family.samples:
                if (sample.name, sample.labels.get("actuator_id")) == key:
                    said["metrics"] = sample.value == OK
        for row in self.fleet.rows(self.clock_s, self.now_ns):
            if row.actuator_id == name:
                said["terminal"] = row.level == OK
        if name in self.latched:
            said["topic"] = self.latched[name].level == OK
        if self.is_active:
            tasks = unit_tasks(self.actuators[name], 0)[1:]
            said |= {task.name: task.level == OK for task in tasks[:1]}
        return [sink for sink, is_ok in said.items() if is_ok]

    def teardown(self) -> None:
        """Remove the files."""
        super().teardown()
        for unit in self.units.values():
            unit.history.close()
        self._folder.cleanup()
