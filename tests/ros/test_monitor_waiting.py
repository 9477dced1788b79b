# SPDX-License-Identifier: Apache-2.0
"""Windows that wait for their identification: each is answered."""

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
from ema_monitor.reasons import StatedReason
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

from .monitor_session import MonitorSession, Source, in_window, monitor


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """Event that lets windows be identified, as healthy, when it is set."""
    may, identified = threading.Event(), diagnosis._identified

    def held(window: Window | Refusal, *arguments: Any) -> Any:
        if isinstance(window, Refusal):
            return (yield from identified(window, *arguments))
        while not may.wait(0.01):
            yield None
        calibration, settings = arguments[1:3]
        return replace(
            refusal(window, calibration, settings, StatedReason("")),
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


def none_waits_of(session: MonitorSession, windows: int) -> bool:
    """Return whether a number of windows has arrived and the last one is being identified."""
    counts = [count(session, "flap telemetry", key) for key in ("windows", "windows waiting")]
    return counts == [windows, 0]


def outcomes(session: MonitorSession) -> list[tuple[int, bool]]:
    return [(estimate.window, estimate.valid) for estimate in session.estimates()]


def test_oldest_window_is_dropped_and_waiting_ones_refused_on_deactivation(held: threading.Event):
    source = Source()
    with monitor({"waiting_windows": 1}) as session:
        session.describe()
        session.feed(source.cycle())
        # The first window waits while kernels are compiled.
        session.until(lambda: none_waits_of(session, 1))
        for _ in range(2):
            session.feed(source.cycle())
        session.until(lambda: count(session, "input", "windows dropped") == 1)
        held.set()
        session.until(lambda: outcomes(session) == [(0, True), (1, False), (2, True)])
        assert "dropped: more than 1 window waited" in session.estimates()[1].reason
        held.clear()
        session.feed(source.cycle())
        session.until(lambda: none_waits_of(session, 4))
        session.feed(source.cycle())
        blocks = source.cycle()
        session.feed(blocks[: in_window(blocks)])
        total = 5 * 34 + in_window(blocks)
        session.until(lambda: count(session, "flap telemetry", "blocks") == total)
        assert session.change_state(Transition.TRANSITION_DEACTIVATE)
        session.until(lambda: len(session.estimates()) == 6)
        assert outcomes(session)[3:] == [(number, False) for number in (3, 4, 5)]
        for estimate, reason in zip(
            session.estimates()[3:],
            ("stopped during", "stopped before", "the telemetry ends"),
            strict=True,
        ):
            assert reason in estimate.reason
        held.set()
        assert session.change_state(Transition.TRANSITION_ACTIVATE)
        session.until_subscribed()
        session.feed(Source().cycle())
        session.until(lambda: outcomes(session)[6:] == [(6, True)])


def test_no_window_is_dropped_in_simulated_time(held: threading.Event):
    source = Source()
    with monitor({"waiting_windows": 1, "use_sim_time": True}) as session:
        clock = session.probe.create_publisher(Clock, "/clock", 10)
        session.describe()
        for _ in range(3):
            session.feed(source.cycle())
        session.until(lambda: count(session, "flap telemetry", "windows") == 3)
        assert clock.get_subscription_count()
        held.set()
        session.until(lambda: outcomes(session) == [(number, True) for number in range(3)])
        session.until(lambda: count(session, "input", "windows dropped") == 0)
