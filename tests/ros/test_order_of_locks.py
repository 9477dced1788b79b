# SPDX-License-Identifier: Apache-2.0
"""Deactivation while a history is being opened causes no deadlock."""

import threading
from pathlib import Path
from typing import Any

import pytest

from ema_monitor.node.receive.receiver import Receiver
from ema_monitor.node.work import histories
from ema_monitor.node.work.histories import Histories
from ema_monitor.prognosis.history import History, history_path
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit
from ema_ros.messages import telemetry_to_message

from ..prognosis.made_tests import made_test
from ..waiting import DEADLINE_S
from .monitor_session import FLAP, Source, monitor


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Folder with the history of a unit with one test; opening it publishes its health."""
    unit = Unit(History(*FLAP.unit_key, history_path(tmp_path, *FLAP.unit_key)))
    assert unit.update(made_test(0), None, PrognosisSettings())
    unit.history.close()
    return tmp_path


def test_window_that_ends_while_a_history_is_opened_is_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch
):
    """One thread opens the history to publish health, the other receives the window's end."""
    begun, may_open, is_asked = threading.Event(), threading.Event(), threading.Event()
    receiving: set[int] = set()
    of = Histories.of

    def open_slowly(*args: Any) -> History:
        begun.set()
        assert may_open.wait(DEADLINE_S)
        return History(*args)

    def ask(self: Histories, *args: Any) -> Unit:
        if threading.get_ident() in receiving:
            is_asked.set()
        return of(self, *args)

    def receive(receiver: Receiver) -> None:
        receiving.add(threading.get_ident())
        for block in Source().cycle():
            receiver.receive_telemetry(telemetry_to_message(block, FLAP.actuator_id))

    monkeypatch.setattr(histories, "History", open_slowly)
    monkeypatch.setattr(Histories, "of", ask)
    with monitor({"history_folder": str(folder)}) as session:
        session.mount()
        assert begun.wait(DEADLINE_S)
        session.node.work.worker.stop()  # as deactivation begins
        thread = threading.Thread(target=receive, args=(session.node.receiver,), daemon=True)
        thread.start()
        assert is_asked.wait(DEADLINE_S)
        may_open.set()
        thread.join(DEADLINE_S)
        assert not thread.is_alive()
        session.until(lambda: len(session.estimates()) == 1)
        assert "not active" in session.estimates()[0].reason
        session.until(session.healths)
