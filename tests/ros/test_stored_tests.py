# SPDX-License-Identifier: Apache-2.0
"""A stored test that is sent later gives no OK if its stamps do not show its age."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from ema_core.description import ActuatorDescription
from ema_core.levels import LEVEL_NAMES, STALE
from ema_interfaces.msg import Health
from ema_monitor.diagnosis import Diagnosed
from ema_monitor.node.publish.actuator_status import ActuatorStatus
from ema_monitor.node.receive.arrivals import Arrivals
from ema_monitor.node.receive.receiver_clock import ReceiverClock
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit
from ema_monitor.windows.finder import WindowFinder
from ema_monitor.windows.trigger import TriggerSettings

from ..prognosis.made_tests import FIRST_NS, UNIT, made_test

S = 10**9
BLOCK_NS = S // 10
LIVE = PrognosisSettings(good_for_s=30.0)
FLAP = ActuatorDescription(actuator_id=UNIT[0], serial_number=UNIT[1])


class Bench:
    """A monitor of one unit with its history, and the clocks of the machine."""

    def __init__(self, settings: PrognosisSettings = LIVE, folder: Path | None = None) -> None:
        self.settings, self.folder = settings, folder
        self.clock_ns, self.steady_ns, self.boot = FIRST_NS, 1000 * S, "boot 1"
        self.tests = 0
        self.start()

    def start(self) -> None:
        self.published: list[Health] = []
        kept = self.folder / "clock.json" if self.folder else None
        self.clock = ReceiverClock(
            lambda: self.clock_ns,
            steady_ns=lambda: self.steady_ns,
            kept=kept,
            boot_id=lambda: self.boot,
        )
        path = self.folder / "flap+SIM-0001.sqlite" if self.folder else None
        self.unit = Unit(History(*UNIT, path), self.settings)
        self.arrivals = Arrivals()
        self.actuator = ActuatorStatus(
            "flap",
            WindowFinder(TriggerSettings()),
            self.published.append,
            self.steady_ns,
            self.arrivals,
        )
        self.actuator.finder.describe(FLAP)
        self.moment()
        if (outlook := self.unit.resume(None, self.settings)) is not None:
            self.actuator.health.resume(FLAP, outlook, self.moment())

    def moment(self):
        moment, back_ns = self.clock.read()
        if back_ns:
            self.actuator.health.end_claim("the clock went back")
        return moment

    def wait(self, seconds: float, step_s: float = 0.0) -> None:
        self.steady_ns += round(seconds * S)
        self.clock_ns += round((seconds + step_s) * S)
        self.actuator.expire(30.0, self.moment())

    def test(self, end_ns: int | None = None, *, pace: float = 1.0, friction: float = 0.02) -> str:
        """Receive a test with 1 s of telemetry, and return the published level.

        ``end_ns`` is the stamp of its end; by default, the present time plus 1 s. ``pace`` is the
        ratio of reception time to measurement time: 1 is real time; with 0, all telemetry arrives
        at once.
        """
        end_ns = self.clock_ns + S if end_ns is None else end_ns
        for block in range(10):
            self.wait(0.1 * pace)
            block_end_ns = end_ns - (9 - block) * BLOCK_NS
            self.arrivals.add(block_end_ns - BLOCK_NS, block_end_ns, self.steady_ns)
        made = made_test(self.tests, seed=3, friction=friction)
        estimate = replace(made, start_ns=end_ns - S // 2, end_ns=end_ns)
        self.tests += 1
        now = self.moment()
        is_live = self.arrivals.are_live(end_ns)
        outlook = self.unit.update(
            estimate, None, self.settings, received_ns=now.clock_ns, is_live=is_live
        )
        self.actuator.record(Diagnosed(0, 0, FLAP, estimate), outlook, self.moment())
        return self.level

    @property
    def level(self) -> str:
        return LEVEL_NAMES[self.published[-1].level] if self.published else LEVEL_NAMES[STALE]

    @property
    def reason(self) -> str:
        return self.published[-1].reason


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.mark.parametrize("back_s", [-20.0, -600.0, -3600.0])
@pytest.mark.parametrize("has_tests", [True, False])
def test_stored_test_after_a_backward_step_is_stale(back_s: float, has_tests: bool):
    """The clock shows the time of its stamp twice, so that the test looks new."""
    bench = Bench()
    if has_tests:
        assert bench.test() == "OK"
    bench.wait(40.0)
    bench.wait(1.0, back_s)
    # The test ended 3 s before now by the clock, or 1 s before the step.
    for end_ns in (bench.clock_ns - 3 * S, bench.clock_ns - round(back_s * S) - 2 * S):
        assert bench.test(end_ns, pace=0.0) == "STALE"
    assert "the clock went back" in bench.reason
    assert "has_clock" not in bench.reason
    assert bench.test() == "OK"


def test_stored_test_is_stale_until_the_clock_passes_the_time_of_the_step(bench: Bench):
    bench.wait(1.0, -600.0)
    levels = [bench.test(pace=0.0)]
    bench.wait(603.0)
    assert bench.test(bench.clock_ns - 5 * S, pace=0.0) == "STALE"
    levels.append(bench.test(bench.clock_ns - S, pace=0.0))
    assert levels == ["STALE", "OK"]


def test_stored_test_of_a_fault_after_a_step_shows_the_fault(bench: Bench):
    bench.wait(1.0, -600.0)
    assert bench.test(pace=0.0, friction=0.8) == "ERROR"


@pytest.mark.parametrize(
    ("ahead_s", "has_clock"), [(1800.0, True), (-1e9, True), (-1e9, False), (5.0, False)]
)
@pytest.mark.parametrize("streams", [True, False])
def test_stored_test_with_stamps_without_a_date_is_stale(
    ahead_s: float, has_clock: bool, streams: bool
):
    """An actuator that never sends during a test is trusted to send immediately after it."""
    bench = Bench(replace(LIVE, has_clock=has_clock))
    for _ in range(20 * streams):
        bench.wait(0.1)
        end_ns = bench.clock_ns + round((ahead_s - 10.0) * S)
        bench.arrivals.add(end_ns - BLOCK_NS, end_ns, bench.steady_ns)
    assert bench.arrivals.has_streamed == streams
    if ahead_s < 0.0 and not streams:
        assert bench.test(bench.clock_ns + round(ahead_s * S), pace=0.0) == "OK"
        return
    assert bench.test(bench.clock_ns + round(ahead_s * S), pace=0.0) == "STALE"
    assert "when" in bench.reason
    # This test is accepted because it is received while it is measured.
    assert bench.test(bench.clock_ns + round((ahead_s + 20.0) * S)) == "OK"


@pytest.mark.parametrize(
    ("down_s", "step_s", "boot", "level"),
    [
        (10.0, 0.0, "boot 1", "OK"),
        (40.0, 0.0, "boot 1", "STALE"),
        # Only the clock shows 20 s since the test.
        (40.0, -20.0, "boot 1", "STALE"),
        (10.0, 0.0, "boot 2", "STALE"),
    ],
)
def test_level_of_a_history_is_shown_only_if_the_clock_was_followed(
    tmp_path: Path, down_s: float, step_s: float, boot: str, level: str
):
    bench = Bench(folder=tmp_path)
    assert bench.test() == "OK"
    bench.unit.history.close()
    bench.clock_ns += round((down_s + step_s) * S)
    bench.steady_ns += round(down_s * S)
    bench.boot = boot
    bench.start()
    assert bench.level == level
    # A stored test from the time that the clock has shown twice.
    if step_s:
        assert bench.test(bench.clock_ns - S, pace=0.0) == "STALE"
    assert bench.test() == "OK"


def test_test_ahead_of_simulated_time_is_accepted(bench: Bench):
    """A player may send telemetry before the simulated time reaches its stamps."""
    bench.clock = ReceiverClock(lambda: bench.clock_ns, is_simulated=True)
    assert bench.test(bench.clock_ns + 5 * S, pace=0.0) == "OK"


def test_fault_of_a_history_is_shown_after_a_reboot(tmp_path: Path):
    bench = Bench(folder=tmp_path)
    assert bench.test(friction=0.8) == "ERROR"
    bench.unit.history.close()
    bench.boot = "boot 2"
    bench.start()
    assert bench.level == "ERROR"


@pytest.mark.parametrize("damage", ["", "[]", "{", '{"boot_id": 3}'])
def test_damaged_clock_file_is_rewritten(tmp_path: Path, damage: str):
    kept = tmp_path / "clock.json"
    kept.write_text(damage)

    def clock() -> ReceiverClock:
        return ReceiverClock(
            lambda: FIRST_NS, steady_ns=lambda: 5 * S, kept=kept, boot_id=lambda: "boot"
        )

    assert not clock().read()[0].is_continued
    assert clock().read()[0].is_continued


def arrivals(blocks: int, pace: Callable[[int], float]) -> Arrivals:
    result, steady_s = Arrivals(), 0.0
    for block in range(blocks):
        steady_s += pace(block)
        result.add(block * BLOCK_NS, (block + 1) * BLOCK_NS, round(steady_s * S))
    return result


@pytest.mark.parametrize(
    ("blocks", "pace", "is_live"),
    [
        (30, lambda _: 0.1, True),
        (30, lambda _: 0.0, False),
        # The last ten blocks came at once, the earlier blocks in real time.
        (30, lambda block: 0.1 * (block < 20), False),
        # A busy receiver takes the last two blocks at once.
        (30, lambda block: 0.1 * (block < 28), True),
        # After a pause.
        (30, lambda block: 5.0 * (block == 25), False),
        (30, lambda block: 5.0 * (block == 20), False),
        (1, lambda _: 0.1, False),
        (0, lambda _: 0.1, False),
    ],
)
def test_telemetry_that_arrives_as_it_is_measured_is_live(blocks: int, pace, is_live: bool):
    assert arrivals(blocks, pace).are_live(blocks * BLOCK_NS) == is_live


@pytest.mark.parametrize(
    ("pace", "streams"), [(0.1, True), (0.12, True), (0.06, False), (0.3, False)]
)
def test_sender_that_is_not_in_real_time_does_not_stream(pace: float, streams: bool):
    """Stored telemetry that a busy machine sends slowly must not count as streamed."""
    assert arrivals(30, lambda _: pace).has_streamed == streams


def test_telemetry_of_a_repeated_time_is_live_if_both_were_live():
    twice = arrivals(30, lambda _: 0.1)
    assert twice.are_live(25 * BLOCK_NS)
    for block in range(10, 25):
        twice.add(block * BLOCK_NS, (block + 1) * BLOCK_NS, 10 * S)
    assert not twice.are_live(25 * BLOCK_NS)
    assert twice.are_live(30 * BLOCK_NS)
