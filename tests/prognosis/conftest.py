# SPDX-License-Identifier: Apache-2.0
"""Fixtures: the path of a history, and requirements that several test files only read."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from ema_core.parameters import ActuatorParameters
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.requirements.requirements import Requirements


@pytest.fixture(autouse=True)
def _histories_are_closed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Close histories that a test leaves open, because Python 3.13 warns of open databases."""
    made: list[History] = []
    initialise = History.__init__

    def note(self: History, actuator_id: str, serial_number: str, path: Path | None = None) -> None:
        made.append(self)
        initialise(self, actuator_id, serial_number, path)

    monkeypatch.setattr(History, "__init__", note)
    yield
    for history in made:
        history.close()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return the path of a history, whose folder does not exist."""
    return tmp_path / "histories" / "flap.sqlite"


@pytest.fixture(scope="session")
def requirements() -> Requirements:
    """Return the requirements of the built-in actuator."""
    return Requirements(ActuatorParameters())
