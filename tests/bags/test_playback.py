# SPDX-License-Identifier: Apache-2.0
"""Messages are played at their recorded times, and the latest latched messages are known."""

import threading
from pathlib import Path

import pytest
from rclpy.serialization import deserialize_message

from ema_bags import playback
from ema_bags.playback import Playback
from ema_bags.played_bag import PlayedBag, PlayerSettings
from ema_bags.recording import MessagePlace, Recorded
from ema_bags.writer import BagWriter
from ema_interfaces.msg import Health
from ema_ros import topics

from ..waiting import SimulatedTime

START_NS = 1_700_000_000_000_000_000
STEP_NS = 10_000_000


def recorded(count: int) -> list[Recorded]:
    return [
        Recorded(MessagePlace(START_NS + number * STEP_NS, 0, 0, 0), "/t", "", str(number), 0)
        for number in range(count)
    ]


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimulatedTime:
    """Return the simulated time that the playback uses."""
    clock = SimulatedTime()
    monkeypatch.setattr(playback, "time", clock)
    return clock


@pytest.mark.parametrize("rate", [1.0, 5.0])
def test_messages_are_played_at_their_times(clock: SimulatedTime, rate: float):
    begin_s = clock.now_s
    published: list[tuple[int, float]] = []
    played = Playback(
        recorded(50),
        rate,
        0.01,
        lambda item: published.append((item.log_time_ns, clock.now_s)),
        lambda _: None,
    )
    assert played.run(clock)
    assert [log_time_ns for log_time_ns, _ in published] == [
        START_NS + number * STEP_NS for number in range(50)
    ]
    # Adding and subtracting times of 100 s has rounding errors of about 1e-14 s.
    assert [at - begin_s for _, at in published] == pytest.approx(
        [number * 0.01 / rate for number in range(50)], abs=1e-12
    )


def test_delays_do_not_accumulate(clock: SimulatedTime):
    begin_s = clock.now_s

    def publish(_: Recorded) -> None:
        clock.now_s += 0.005

    assert Playback(recorded(51), 1.0, 0.01, publish, lambda _: None).run(clock)
    assert clock.now_s - begin_s == pytest.approx(
        0.505, abs=1e-9
    )  # The total would be 0.755 s if delays accumulated.


def test_clock_continues_between_messages_but_not_past_the_next(clock: SimulatedTime):
    events: list[tuple[str, int]] = []
    played = Playback(
        [recorded(1)[0], *recorded(41)[20:21], *recorded(41)[40:]],
        1.0,
        0.01,
        lambda item: events.append(("message", item.log_time_ns - START_NS)),
        lambda stamp_ns: events.append(("tick", stamp_ns - START_NS)),
    )
    assert played.run(clock)
    times = [at for _, at in events]
    assert times == sorted(times)
    assert (times[0], times[-1]) == (0, 40 * STEP_NS)
    assert events[-1][0] == "tick"
    # One every 10 ms, and one at the end.
    assert len([at for kind, at in events if kind == "tick"]) in (41, 42)


def test_recorded_time_stops_while_nothing_is_played(clock: SimulatedTime):
    ticks: list[int] = []
    items = [recorded(1)[0], recorded(31)[30]]
    played = Playback(items, 1.0, 0.01, lambda _: None, ticks.append)
    stopped = SimulatedTime(set_at_s=0.1)
    clock.monotonic = stopped.monotonic
    assert not played.run(stopped)
    assert played.played == 1
    # The clock is 0.09 s behind the last played message, and an hour passes.
    reached_s = (played.reached_ns - START_NS) / 1e9
    assert 0.0 < reached_s <= 0.1
    clock.monotonic = lambda: clock.now_s
    clock.now_s = begin_s = 3700.0
    assert played.run(clock)
    assert clock.now_s - begin_s == pytest.approx(0.3 - reached_s, abs=1e-9)
    assert ticks == sorted(ticks)
    assert played.played == 2


def test_player_that_is_late_stops_before_the_next_message():
    stop = threading.Event()
    together = [recorded(1)[0]] * 5
    played = Playback(together, 1.0, 0.01, lambda _: stop.set(), lambda _: None)
    assert not played.run(stop)
    assert played.played == 1


def test_latest_message_of_each_actuator_is_latched_at_any_position(tmp_path: Path):
    path = tmp_path / "long.mcap"
    with BagWriter(path, chunk_bytes=4096) as writer:
        writer.add_topic("/ema/health", Health, topics.LATCHED)
        for number in range(1000):
            if number % 100 in (0, 10):
                name = "right" if number % 100 else "left"
                at_ns = 10**9 + number * 10**8
                writer.write("/ema/health", Health(actuator_id=name, cycles=number), at_ns)
    played = PlayedBag(PlayerSettings(bag=str(path)), None)
    for seconds, expected in (
        (50.05, [("right", 410), ("left", 500)]),
        (0.0, []),
        (0.5, [("left", 0)]),
        (95.0, [("left", 900), ("right", 910)]),
        (40.0, [("left", 300), ("right", 310)]),
        (40.05, [("right", 310), ("left", 400)]),
    ):
        items = played.latched_before(10**9 + round(seconds * 1e9))
        messages = [deserialize_message(item.message, Health) for item in items]
        assert [(message.actuator_id, message.cycles) for message in messages] == expected
