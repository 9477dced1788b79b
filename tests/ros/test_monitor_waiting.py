"""Windows that wait for their identification: none vanishes, whatever becomes of it."""

import threading
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from lifecycle_msgs.msg import Transition
from rosgraph_msgs.msg import Clock

from ema_core.faults import healthy_faults
from ema_monitor import diagnosis
from ema_monitor.identification.estimate import refusal
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

from .monitor_session import MonitorSession, Source, in_window, monitor


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """A window is identified when this is set, and nothing is wrong with it."""
    may, identified = threading.Event(), diagnosis._identified

    def held(window: Window | Refusal, *others: Any) -> Any:
        if isinstance(window, Refusal):
            return (yield from identified(window, *others))
        while not may.wait(0.01):
            yield None
        calibration, settings = others[1:3]
        return replace(
            refusal(window, calibration, settings, ""),
            valid=True,
            faults=healthy_faults(),
            covariance=1e-6 * np.eye(8),
            unobservable=np.zeros(8, dtype=bool),
            goodness_of_fit=1.0,
        )

    monkeypatch.setattr(diagnosis, "_identified", held)
    yield may
    may.set()


def count(session: MonitorSession, task: str, key: str) -> int:
    values = [i.value for s in session.statuses(task)[-1:] for i in s.values if i.key == key]
    return int(values[0]) if values else -1


def under_identification(session: MonitorSession) -> bool:
    """Whether the first window has come and waits no more."""
    counts = [count(session, "flap telemetry", key) for key in ("windows", "windows waiting")]
    return counts == [1, 0]


def test_oldest_window_is_dropped_when_too_many_wait(held: threading.Event):
    source = Source()
    with monitor({"waiting_windows": 1}) as session:
        session.describe()
        session.feed(source.cycle())
        # The first one waits as long as kernels are compiled.
        session.until(lambda: under_identification(session))
        for _ in range(3):
            session.feed(source.cycle())
        session.until(lambda: count(session, "flap telemetry", "windows") == 4)
        held.set()
        session.until(lambda: len(session.estimates()) == 4)
        assert [e.window for e in session.estimates()] == [0, 1, 2, 3]
        assert [e.valid for e in session.estimates()] == [True, False, False, True]
        for estimate in session.estimates()[1:3]:
            assert "dropped: more than 1 window waited" in estimate.reason
        session.until(lambda: count(session, "input", "windows dropped") == 2)


def test_none_is_dropped_in_simulated_time(held: threading.Event):
    source = Source()
    with monitor({"waiting_windows": 1, "use_sim_time": True}) as session:
        clock = session.probe.create_publisher(Clock, "/clock", 10)
        session.describe()
        for _ in range(3):
            session.feed(source.cycle())
        session.until(lambda: count(session, "flap telemetry", "windows") == 3)
        assert clock.get_subscription_count()
        held.set()
        session.until(lambda: len(session.estimates()) == 3)
        assert [(e.window, e.valid) for e in session.estimates()] == [(i, True) for i in range(3)]
        session.until(lambda: count(session, "input", "windows dropped") == 0)


def test_what_waits_is_refused_on_deactivation_and_work_goes_on_after(held: threading.Event):
    source = Source()
    with monitor() as session:
        session.describe()
        for _ in range(2):
            session.feed(source.cycle())
        blocks = source.cycle()
        session.feed(blocks[: in_window(blocks)])
        total = 2 * 34 + in_window(blocks)
        session.until(lambda: count(session, "flap telemetry", "blocks") == total)
        assert session.change_state(Transition.TRANSITION_DEACTIVATE)
        session.until(lambda: len(session.estimates()) == 3)
        assert [(e.window, e.valid) for e in session.estimates()] == [(i, False) for i in range(3)]
        for estimate, reason in zip(
            session.estimates(),
            ("stopped during", "stopped before", "the telemetry ends"),
            strict=True,
        ):
            assert reason in estimate.reason
        held.set()
        assert session.change_state(Transition.TRANSITION_ACTIVATE)
        session.until_subscribed()
        session.feed(Source().cycle())
        estimate = session.until(lambda: session.estimates()[3:])[0]
        assert (estimate.window, estimate.valid) == (3, True)
