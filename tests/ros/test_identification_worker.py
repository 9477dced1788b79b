# SPDX-License-Identifier: Apache-2.0
"""The identification thread: every window gets an estimate, and its end is reported."""

import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from ema_core import steady_thread
from ema_core.description import ActuatorDescription
from ema_core.levels import ERROR, OK, WARN
from ema_monitor.diagnosis import Diagnosed
from ema_monitor.identification import combination
from ema_monitor.identification.combination import Combination
from ema_monitor.identification.estimate import refusal
from ema_monitor.identification.search import Generation, ModelIdentification, Search
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings, Tally
from ema_monitor.node.work import worker as identification_worker
from ema_monitor.node.work.worker import IdentificationWorker
from ema_monitor.reason_texts import text_of
from ema_monitor.reasons import MonitorInactive, NoCalibration, StatedReason
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

from ..monitor.windows import window_from
from ..waiting import wait_for

WINDOW = window_from(np.linspace(0.0, 1.0, 3))
DEADLINE_S = 10.0
NONE = text_of(NoCalibration("c.yaml"))


def found(number: int, window: Window | Refusal = WINDOW) -> Segment:
    return Segment(number, ActuatorDescription(), window)


class Published:
    """Fake of a node that collects a worker's results. It has no calibration."""

    def __init__(self) -> None:
        self.estimates: list[tuple[int, str]] = []
        self.errors: list[str] = []
        self.settings = SimpleNamespace(
            search=SimpleNamespace(value=SearchSettings()),
            combining=SimpleNamespace(value=CombinationSettings()),
            operation=SimpleNamespace(value=SimpleNamespace(waiting_windows=None)),
        )
        self.status = SimpleNamespace(tally=Tally())
        self.hold: Callable[[], Any] = lambda: None
        self._changed = threading.Condition()

    def worker(self) -> IdentificationWorker:
        worker = IdentificationWorker(
            results=cast(Any, self),
            histories=cast(Any, SimpleNamespace(estimates=lambda _: [])),
            actuators=cast(Any, {"flap": self.status}),
            settings=cast(Any, self.settings),
            baselines=cast(Any, SimpleNamespace(learn=lambda _: None, note=lambda *_: None)),
            store=cast(Any, SimpleNamespace(of=lambda _: NoCalibration("c.yaml"))),
            log=cast(Any, self),
            is_simulated=True,
        )
        worker.follow("flap")
        return worker

    def until(self, condition: Callable[[], bool]) -> None:
        with self._changed:
            assert self._changed.wait_for(condition, DEADLINE_S), self.estimates

    def _note(self, reported: list[Any], result: Any) -> None:
        with self._changed:
            reported.append(result)
            self._changed.notify_all()

    def report_end(self, text: str, trace: str) -> None:
        self._note(self.errors, f"{text}\n{trace}")

    def failed(self, where: str, what: str, error: Exception) -> str:
        self.report_end(f"{where}: {what}", repr(error))
        return f"{what} failed: {error!r}"

    def publish(self, diagnosed: Diagnosed, window: Any = None) -> None:
        self.hold()
        self._note(self.estimates, (diagnosed.number, diagnosed.estimate.reason))


@pytest.fixture
def published() -> Published:
    return Published()


@pytest.fixture
def may_identify(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """Event that lets identifications continue when it is set."""
    event = threading.Event()
    identify = IdentificationWorker._diagnosed

    def wait(self: IdentificationWorker, *args: Any) -> Any:
        assert event.wait(DEADLINE_S)
        return identify(self, *args)

    monkeypatch.setattr(IdentificationWorker, "_diagnosed", wait)
    monkeypatch.setattr(identification_worker, "_JOIN_S", 0.0)
    yield event
    event.set()


def test_settings_unsuitable_for_motion_are_named_without_a_traceback(published: Published):
    published.settings.search.value = SearchSettings(fitness="least_squares")
    worker = published.worker()
    worker.start()
    worker.add(replace(found(0), is_stretch=True))
    wait_for(lambda: published.status.tally.reason, "the reason")
    worker.stop()
    assert "'least_squares'" in published.status.tally.reason
    assert (published.errors, published.estimates) == ([], [])


@pytest.mark.parametrize("how", [SystemExit, MemoryError], ids=lambda how: how.__name__)
def test_thread_that_ends_refuses_its_window_and_is_restarted(
    published: Published, monkeypatch: pytest.MonkeyPatch, how: type[BaseException]
):
    monkeypatch.setattr(steady_thread, "_FIRST_WAIT_S", 0.2)
    identify = IdentificationWorker._identify_and_publish

    def fail_once(self: IdentificationWorker, segment: Segment, *args: Any) -> None:
        if segment.number == 0:
            raise how("made up")
        identify(self, segment, *args)

    monkeypatch.setattr(IdentificationWorker, "_identify_and_publish", fail_once)
    worker = published.worker()
    worker.start()
    for number in range(3):
        worker.add(found(number))
    published.until(lambda: len(published.estimates) == 3)
    level, message = worker.status()
    assert (level, worker.thread.ends) == (ERROR, 1)
    assert "the identification thread has ended: " + how.__name__ in message
    assert "Traceback" in published.errors[0]
    assert [number for number, _ in published.estimates] == [0, 1, 2]
    assert [reason for _, reason in published.estimates[1:]] == [NONE] * 2
    assert published.estimates[0][1] == message
    worker.stop()


def test_window_outside_of_start_and_stop_is_refused(published: Published):
    worker = published.worker()
    assert not worker.add(found(0))
    worker.start()
    assert worker.add(found(1))
    published.until(lambda: len(published.estimates) == 1)
    worker.stop()
    assert worker.status()[0] == WARN
    for segment in (found(2), found(3, Refusal(5, 6, StatedReason("gap")))):
        assert not worker.add(segment)
        worker.refuse(segment, MonitorInactive(), is_dropped=True)
    assert published.estimates == [(1, NONE), (2, "the monitor is not active"), (3, "gap")]


def test_windows_that_wait_at_the_stop_are_refused_in_order(
    published: Published, may_identify: threading.Event
):
    worker = published.worker()
    worker.start()
    for number in range(3):
        worker.add(found(number))
    wait_for(lambda: len(worker.queue) == 2, "the first to be identified")
    thread = worker.thread
    worker.stop()
    assert [number for number, _ in published.estimates] == [0, 1, 2]
    assert "stopped during" in published.estimates[0][1]
    assert all("stopped before" in reason for _, reason in published.estimates[1:])
    # The thread that is still in a search does not disturb the next thread.
    worker.start()
    may_identify.set()
    worker.add(found(3))
    published.until(lambda: len(published.estimates) == 4)
    wait_for(lambda: not thread.is_alive, "the end of that thread")
    worker.stop()
    assert published.estimates[3:] == [(3, NONE)]


def test_stop_waits_for_the_estimate_that_is_being_published(
    published: Published, monkeypatch: pytest.MonkeyPatch
):
    """Otherwise the publishers would be destroyed while it is publishing."""
    monkeypatch.setattr(identification_worker, "_JOIN_S", 0.0)
    begun, stopped = threading.Event(), threading.Event()
    returned: list[bool] = []

    def hold() -> None:
        begun.set()
        # A stop that does not wait would return immediately.
        returned.append(stopped.wait(0.2))

    published.hold = hold
    worker = published.worker()
    worker.start()
    worker.add(found(0))
    assert begun.wait(DEADLINE_S)
    worker.stop()
    stopped.set()
    assert returned == [False]
    assert published.estimates == [(0, NONE)]


def test_window_that_cannot_be_published_does_not_end_the_others(published: Published):
    def fail() -> None:
        raise OverflowError("made up")

    worker = published.worker()
    published.hold = fail
    worker.start()
    worker.add(found(0))
    published.until(lambda: len(published.errors) == 1)
    published.hold = lambda: None
    worker.add(found(1))
    published.until(lambda: published.estimates == [(1, NONE)])
    assert worker.status()[0] == OK
    worker.stop()


class _Endless(ModelIdentification):
    """An identification that continues until it is stopped."""

    begun = threading.Event()

    def run(self) -> Search:
        while True:
            self.begun.set()
            yield Generation(1, 1, 0.0, np.zeros(8))


def test_stop_ends_the_identification_of_a_stretch_at_once(
    published: Published, monkeypatch: pytest.MonkeyPatch
):
    """The stretches combined before are published, the unfinished stretch is not."""
    monkeypatch.setattr(combination, "ModelIdentification", _Endless)
    monkeypatch.setattr(Combination, "_is_worthwhile", lambda *_: True)
    estimate = refusal(
        Refusal(5, 6, StatedReason("")),
        NoCalibration("calibration.yaml"),
        SearchSettings(),
        StatedReason("combined so far"),
    )
    monkeypatch.setattr(Combination, "finish", lambda _: [estimate])
    _Endless.begun.clear()
    worker = published.worker()
    worker.start()
    worker.add(replace(found(0), is_stretch=True))
    assert _Endless.begun.wait(DEADLINE_S)
    thread = worker.thread
    worker.stop()
    assert not thread.is_alive
    assert published.estimates == [(0, "combined so far")]
