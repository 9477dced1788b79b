# SPDX-License-Identifier: Apache-2.0
"""Prognosis of a unit under tests, repairs, revoked counts, restarts and replays."""

import math
import shutil
import tempfile
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from hypothesis import strategies as st
from hypothesis.stateful import invariant, rule

from ema_core.levels import OK
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Count
from ema_monitor.prognosis.outlook import Claim, Outlook
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit

from ..prognosis.made_tests import UNIT, made_test
from .stateful import Walk

_SETTINGS = PrognosisSettings()
_HOURS = 8.0
_COUNTS = ("none", "right", "right", "right", "high", "low")


class Prognosis(Walk):
    """A unit whose friction grows, and the tests reported for it."""

    def __init__(self) -> None:
        super().__init__()
        memory = "/dev/shm" if Path("/dev/shm").is_dir() else None
        self._folder = tempfile.TemporaryDirectory(prefix="walk_", dir=memory)
        self.path = Path(self._folder.name) / "unit.sqlite"
        self.prognostics = Unit(History(*UNIT, self.path))
        self.number = 0
        self.friction = 0.05
        self.offset_hours = 0.0
        self.reported: list[tuple[Estimate, Count | None]] = []
        self.outlook: Outlook | None = None
        self.rng = np.random.default_rng(7)

    def _tell(self, estimate: Estimate, count: Count | None) -> None:
        outlook = self.prognostics.update(estimate, None, _SETTINGS, count)
        assert outlook is not None or not estimate.valid
        if outlook is None:
            return
        self.outlook = outlook
        assert outlook.health.level in (0, 1, 2, 3)
        self.prognostics.write()

    def _test(
        self, count: str, wrong: float = 0.0, *, valid: bool = True, held: bool = False
    ) -> tuple[Estimate, Count | None]:
        self.friction = min(self.friction + 0.004, 0.6)
        friction = min(max(self.friction + wrong, 0.0), 0.9)
        estimate = made_test(self.number, rng=self.rng, valid=valid, friction=friction)
        right = _HOURS * (self.number + 1) + self.offset_hours
        hours = {"none": math.nan, "right": right, "high": 9.0 * right, "low": right / 4}[count]
        reported = None if math.isnan(hours) else Count(estimate.start_ns, hours, 0)
        self.number += 1
        if not held:
            self.reported.append((estimate, reported))
            self._tell(estimate, reported)
        return estimate, reported

    @rule(count=st.sampled_from(_COUNTS), tests=st.integers(1, 3))
    def test(self, count: str, tests: int) -> None:
        """Test the unit, with a count of its service hours or without."""
        for _ in range(tests):
            self._test(count)

    @rule()
    def refuse(self) -> None:
        """Report a test without a valid estimate."""
        self._test("right", valid=False)

    @rule(valid=st.booleans())
    def report_late(self, *, valid: bool) -> None:
        """Report a test after a later one: the newest test still sets the level."""
        held = self._test("right", valid=valid, held=True)
        self._test("right")
        self.reported.append(held)
        before = self.outlook
        self._tell(*held)
        assert _claim(self.outlook) == _claim(before), "a late test leads"
        if self.outlook and before and self.outlook.health.level == before.health.level == OK:
            # A late test may only make the oldest evidence newer, never older.
            assert self.outlook.claim.oldest_ns >= before.claim.oldest_ns
        if self.outlook and before and self.outlook.health.level != before.health.level:
            # At the edge of a level, a late test may move a value by at most its sigma.
            for now, then in zip(self.outlook.health.faults, before.health.faults, strict=True):
                assert abs(now.value - then.value) <= then.sigma, f"a late test leads {now.name}"

    @rule(size=st.sampled_from((-0.3, 0.3)))
    def err(self, size: float) -> None:
        """Report a single test with a large error."""
        self._test("right", size)
        self._test("right")

    @rule(change=st.sampled_from((-1.0, 0.2)))
    def change(self, change: float) -> None:
        """Repair the unit, or give it a sudden permanent fault, which the next tests show."""
        self.friction = max(self.friction + change, 0.0)
        for _ in range(3):
            self._test("right")

    @rule()
    def replace_counter(self) -> None:
        """Replace the counter of service hours, so that later counts are lower or higher."""
        self.offset_hours += 0.5 * _HOURS * self.number * (-1 if self.offset_hours > 0 else 1)
        for _ in range(3):
            self._test("right")

    @rule(which=st.integers(0, 30))
    def test_again(self, which: int) -> None:
        """Report a test again, which must change nothing."""
        if not self.reported:
            return
        history = self.prognostics.history
        before = len(history.entries) + len(history.late)
        self._tell(*self.reported[which % len(self.reported)])
        after = len(history.entries) + len(history.late)
        assert after == before, "a test was counted twice"

    @rule()
    def start_again(self) -> None:
        """Close and open the history; the outlook must not change."""
        self.prognostics.history.close()
        self._open()

    @rule()
    def kill(self) -> None:
        """Open a copy of the current files, as after a kill; it must have every test."""
        copy = self.path.with_name(f"copy_{self._steps}.sqlite")
        for suffix in ("", "-wal"):
            source = self.path.with_name(self.path.name + suffix)
            if source.exists():
                shutil.copyfile(source, copy.with_name(copy.name + suffix))
        self.prognostics.history.close()
        self.path = copy
        self._open()

    def _open(self) -> None:
        tests = len(self.prognostics.history.entries)
        self.prognostics = Unit(History(*UNIT, self.path))
        assert not self.prognostics.history.problem, self.prognostics.history.problem
        assert len(self.prognostics.history.entries) == tests, "tests are lost"
        resumed = self.prognostics.resume(None, _SETTINGS)
        assert _text(resumed) == _text(self.outlook), "another outlook after a restart"

    @rule()
    def replay(self) -> None:
        """Replay all tests into a history in memory; the outlook must be the same."""
        twin = Unit(History(*UNIT))
        last = None
        for estimate, count in self.reported:
            last = twin.update(estimate, None, _SETTINGS, count) or last
        now = self.prognostics.resume(None, _SETTINGS)
        assert _text(last) == _text(now), "a replay gives another outlook"

    @invariant()
    def hours_never_go_back(self) -> None:
        """Check that service hours ascend and that the file has every valid test once."""
        hours = [test.hours for test in self.prognostics.growth.service.used]
        assert hours == sorted(hours), "service hours go back"
        assert not self.prognostics.history.problem, self.prognostics.history.problem
        history = self.prognostics.history
        stamps = sorted(entry.stamp_ns for entry in (*history.entries, *history.late))
        valid = sorted(estimate.end_ns for estimate, _ in self.reported if estimate.valid)
        assert stamps == valid, "a valid test is missing, or there twice"

    def teardown(self) -> None:
        """Remove the files."""
        super().teardown()
        self.prognostics.history.close()
        self._folder.cleanup()


def _claim(outlook: Outlook | None) -> object:
    return outlook and outlook.claim._replace(oldest_ns=0)


def _text(outlook: Outlook | None) -> str:
    """Return an outlook without events and claim as a text, with all digits."""
    return repr(outlook and asdict(replace(outlook, events=(), claim=Claim())))
